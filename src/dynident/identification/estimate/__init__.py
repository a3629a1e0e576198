"""What an estimator returns: values, covariance, figures of fit and validation."""
