"""What shows that the package is right: the paper, benchmarks, the campaign, judges, mutation."""
