"""What SkelSplat is measured with and against."""
