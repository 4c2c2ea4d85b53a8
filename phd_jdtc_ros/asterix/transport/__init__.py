"""What carries ASTERIX: files, captures and sockets to datagrams, and back."""
