//! Sockets, disk and time.
