// Nothing: the precompiled header of this program is what all tests use.
