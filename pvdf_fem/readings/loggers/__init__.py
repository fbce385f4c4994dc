"""Files of data loggers: one reader for each format, which reads blocks of samples."""
