"""From preprocessed logs to an estimate with its uncertainty."""
