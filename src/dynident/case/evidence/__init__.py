"""What the values of a log say about its units, signs and scales; the draft of a case and the checks judge by it."""
