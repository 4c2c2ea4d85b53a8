"""Transport of ASTERIX: converts files, captures and sockets to datagrams, and back."""
