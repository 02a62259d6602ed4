//! The navigation mesh and the flight over it, by their laws, on small made-up scenes.

mod support;

#[path = "navigation/scenes.rs"]
mod scenes;

#[path = "navigation/mesh_laws.rs"]
mod mesh_laws;

#[path = "navigation/flight_laws.rs"]
mod flight_laws;
