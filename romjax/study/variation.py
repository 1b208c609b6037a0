"""The same reduction of a system with other numbers."""


def vary(rom, basis, system):
    return rom.with_full(system)


def begin(rom, q, v, t):
    return rom.starting_at(q, v, t)
