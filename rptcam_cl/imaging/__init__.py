"""Pictures: the linear film as an array, what is developed from it, and the files both are kept in."""
