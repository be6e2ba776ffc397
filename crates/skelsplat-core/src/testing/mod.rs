//! Scenes and finite differences for tests and benches; not part of the methods.

pub mod differences;
pub mod scenes;
