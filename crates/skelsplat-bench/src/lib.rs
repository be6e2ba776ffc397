//! Benchmarks only: `cargo bench -p skelsplat-bench`.
