"""What explains a log: a quick fit of it, other readings of its columns, and causes of what the fit leaves."""
