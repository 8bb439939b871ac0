"""Parts of the command `study`: design of the cases, runs on a cluster, kept results, Sobol indices, plots."""
