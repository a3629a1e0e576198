"""What an estimator is given: the model, its regressor over the logs, and the QR factors of the samples."""
