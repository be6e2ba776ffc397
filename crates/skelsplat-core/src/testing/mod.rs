//! Scenes and finite differences for tests and benches. No part of the method.

pub mod differences;
pub mod scenes;
