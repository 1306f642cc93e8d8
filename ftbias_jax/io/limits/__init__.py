"""What reading a file may take, whatever the file declares."""
