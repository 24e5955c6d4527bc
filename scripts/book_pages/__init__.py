"""The generated pages of the book: one of each method and effect, the reference of the command line and of Python, the pictures, the table of contents."""
