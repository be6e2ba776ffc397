"""Writers of tiny data sets, each in exactly the layout that a reader reads."""
