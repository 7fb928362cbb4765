"""One module for each format of logs, behind ``jointid.importing.read.reader.Reader``."""
