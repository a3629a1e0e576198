"""What compares methods: benchmark, self-test and the reproduction of the article."""
