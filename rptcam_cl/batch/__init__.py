"""Many pictures: renders on a cluster or in several processes, and datasets with exact truth."""
