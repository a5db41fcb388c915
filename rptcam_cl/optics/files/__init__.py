"""Lens file formats, one module each. Each turns a text into a `Lens`, or says in one line what is wrong and where."""
