"""Writers of tiny data sets in the layouts on disk that the readers know, made from `skelsplat.synthetic`."""
