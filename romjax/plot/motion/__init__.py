"""Moving pictures: of runs and modes, as a page that plays them, as a GIF and as a film."""
