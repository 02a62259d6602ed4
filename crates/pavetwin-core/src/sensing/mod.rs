//! What the camera sees: the recorded traffic, the solids, the surface cells, and which of them are hidden.
