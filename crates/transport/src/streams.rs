//! Who draws random numbers from which stream: of one seed, no two know of each other's.

/// A use of random numbers that has streams of its own, 2⁵⁶ of them from [`Stream::first`] on. The pixels of a picture have those from 0 on.
/// Two of one number do not compile; other numbers are other bytes.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
pub(crate) enum Stream {
    /// Looks for the surfaces that pixels show.
    Guides = 2,
    /// Middles of pixels that share light.
    Middles = 8,
    /// Rows of irradiance of pixels.
    PixelIrradiance = 16,
    /// Walks that look for what throws caustics.
    Casters = 20,
    /// Rows of irradiance of sensor grids.
    GridIrradiance = 32,
    /// Columns of patches.
    PatchRows = 36,
    /// Walks that look for patches.
    PatchScouts = 40,
    /// Light that patches exchange.
    PatchExchange = 44,
    /// Pixels by which patches are judged.
    PatchPixels = 48,
    /// Lamps by which patches are judged.
    PatchTrials = 52,
    /// Points that a camera sees, for lamps that move.
    Visible = 56,
    /// Points where light arrives, for lamps that move.
    Arriving = 58,
    /// Points of lamps that move.
    LampPoints = 60,
    /// Nodes that share light.
    Nodes = 64,
    /// What is seen of beams.
    PatchSight = 65,
    /// Beams of lamps onto patches.
    PatchBeams = 66,
    /// Lamps that a mesh may close in.
    Enclosed = 80,
    /// Walks that look for cells.
    CacheScouts = 96,
    /// Light of cells.
    CacheCells = 112,
    /// Paper by which unlit surfaces get their strength.
    Unlit = 120,
    /// Walks that look for lights that reach nothing.
    Reach = 121,
    /// Areas of patches.
    PatchAreas = 122,
}

impl Stream {
    /// The first of its streams.
    pub(crate) const fn first(self) -> u64 {
        (self as u64) << 56
    }
}
