"""Camera models: a camera of the scene becomes a record, tables and the kernel that reads them."""
