"""The problems that romjax is held to, by theme; `verification` goes through them."""
