//! Any numbers for cameras, solver, recordings, people and rigs: an error or a sound result, never
//! a panic. `PROPTEST_CASES` raises the number of cases (`make fuzz`), then with seeds of their
//! own.

mod any;
mod camera;
mod people;
mod rig;
mod sequence;
mod solver;
