"""Bytes from recordings, captures, sockets and serial lines, whatever they mean."""
