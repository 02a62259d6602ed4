//! The sensing kernels: against an independent brute force, and by the laws they must keep.

mod brute;
mod cameras;
mod laws;
mod named_scenes;
mod random_scenes;
mod scenes;
#[path = "../support/mod.rs"]
mod support;
mod traces;
