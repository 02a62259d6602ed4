//! What the UAV is doing, as the track records it.

/// The number is what the track holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    Ground = 0,
    Climb = 1,
    Transit = 2,
    Inspect = 3,
    Wait = 4,
    Displace = 5,
    Revisit = 6,
    Home = 7,
    Land = 8,
    Swap = 9,
    Avoid = 10,
}

impl Mode {
    /// Names in the order of the numbers.
    pub const NAMES: [&'static str; 11] =
        ["ground", "climb", "transit", "inspect", "wait", "displace", "revisit", "home", "land", "swap", "avoid"];

    /// Whether the rotors are off, so that nothing is drained.
    pub(super) fn is_parked(self) -> bool {
        matches!(self, Self::Ground | Self::Swap)
    }
}
