// All tests use the precompiled header of this program.
