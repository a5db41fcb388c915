"""Lens file formats: each turns a text into a `Lens`, or says in one line what is wrong and where."""
