"""Results: numbers as text, figures and the report."""
