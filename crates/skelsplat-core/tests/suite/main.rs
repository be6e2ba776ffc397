//! Every test of the public interface, in one binary: it links once.

mod annealed;
mod bias;
mod camera;
mod determinism;
mod equations;
mod following;
mod fuzz;
mod gradients;
mod input_checks;
mod layout;
mod live;
mod overlap;
mod people;
mod properties;
mod ransac;
mod recovery;
mod rig;
mod robust_triangulation;
mod sequence;
mod sequence_noise;
mod sequence_parts;
mod triangulate;
