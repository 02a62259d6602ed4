//! The sensing kernels: against an independent brute force, and by the laws they must keep.

mod brute;
mod laws;
mod named_scenes;
mod random_scenes;
mod scenes;
mod traces;
