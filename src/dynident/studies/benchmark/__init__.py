"""Monte Carlo over noise, seeds and initial guesses: many estimators on many virtual robots whose truth is known."""
