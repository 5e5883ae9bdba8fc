"""What is on disk: one writer a file, journals and archives, and the files of the Repository and the Registry."""
