//! Lines of a text file at random access: an index of every so many rows, so that memory does not grow with the file.
