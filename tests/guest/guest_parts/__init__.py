"""Parts of six families, as a package that is not dynident adds them by entry points."""
