//! The seam: one job, two implementations, and what can go wrong in either.

use std::sync::Arc;

use rayon::prelude::*;

use crate::frame::{Frame, Radiance};

/// Why a frame could not be relit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RelightError {
    /// The parts of a frame do not belong together.
    #[error("the frame does not fit together: {0}; bake it again")]
    Frame(String),
    /// A block's factors do not have the shape its tile asks for.
    #[error("block {block} of group {group} is damaged: {reason}; bake it again")]
    Block {
        /// Group of columns.
        group: usize,
        /// Block of the partition.
        block: usize,
        /// What does not fit.
        reason: String,
    },
    /// Not one slice of coefficients per group.
    #[error("the frame has {expected} groups of columns, but coefficients for {found} were given")]
    GroupCount {
        /// Groups of the frame.
        expected: usize,
        /// Slices given.
        found: usize,
    },
    /// Not one coefficient per column.
    #[error("group {group} has {expected} columns, but {found} coefficients were given")]
    ColumnCount {
        /// Group of columns.
        group: usize,
        /// Columns of the group.
        expected: usize,
        /// Coefficients given.
        found: usize,
    },
    /// A coefficient is infinite or not a number.
    #[error("the coefficient of column {col} in group {group} is not a finite number; check that light's intensity")]
    NotFinite {
        /// Group of columns.
        group: usize,
        /// Column within the group.
        col: usize,
    },
    /// A layer of another size than the frame.
    #[error("the layer has {} × {} pixels, but the frame has {} × {}", found[0], found[1], expected[0], expected[1])]
    LayerSize {
        /// Width and height of the frame.
        expected: [u32; 2],
        /// Width and height of the layer.
        found: [u32; 2],
    },
    /// A pixel of a layer is infinite or not a number.
    #[error("pixel {pixel} of the layer is not a finite number; check the lamps that it shows")]
    LayerNotFinite {
        /// Row by row from the top left.
        pixel: usize,
    },
    /// No adapter of the wanted kind is installed.
    #[error("no {wanted} graphics adapter was found; install a Vulkan, Metal or DX12 driver, or relight on the CPU")]
    NoAdapter {
        /// Kind asked for, in words.
        wanted: &'static str,
    },
    /// The driver refused to open a device.
    #[error("the graphics adapter {adapter} gave no device: {reason}; relight on the CPU")]
    NoDevice {
        /// Adapter in words.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// A buffer or texture is larger than the device takes.
    #[error("{what} takes {size}, the graphics device allows {limit}; use a smaller frame, or relight on the CPU")]
    TooLarge {
        /// What is too large.
        what: &'static str,
        /// Its size, in bytes or pixels of a side.
        size: u64,
        /// The device's limit in the same unit.
        limit: u64,
    },
    /// The device has no memory left.
    #[error("the graphics device is out of memory; close other programs, use a smaller frame, or relight on the CPU")]
    OutOfMemory,
    /// The device failed or was lost.
    #[error("the graphics device failed: {0}; relight on the CPU, or open the frame again")]
    Device(String),
}

/// What the last call of [`Relight::relight`] did and what it could leave out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RelightStats {
    /// Blocks whose left factor was read, over all groups; a device leaves out some of these, where `z` stayed the same.
    pub n_expanded: usize,
    /// Blocks left out: dark or unchanged groups, blocks whose `z` stayed the same, blocks without content.
    pub n_skipped: usize,
    /// Those of them that miss the exact answer by less than is seen; on a device they are not counted.
    pub n_unseen: usize,
    /// Groups left out as a whole because all their coefficients are zero.
    pub n_dark_groups: usize,
    /// Factor bytes read; on a device those that it reads at most.
    pub n_bytes: u64,
    /// Command buffers handed to a device; none where nothing changed.
    pub n_submitted: usize,
}

impl RelightStats {
    /// Sums of both.
    pub fn merged(self, other: Self) -> Self {
        Self {
            n_expanded: self.n_expanded + other.n_expanded,
            n_skipped: self.n_skipped + other.n_skipped,
            n_unseen: self.n_unseen + other.n_unseen,
            n_dark_groups: self.n_dark_groups + other.n_dark_groups,
            n_bytes: self.n_bytes + other.n_bytes,
            n_submitted: self.n_submitted + other.n_submitted,
        }
    }

    /// Counts a block that was left as it is, that far behind, nit.
    pub(crate) fn skip(&mut self, behind: f32) {
        self.n_skipped += 1;
        self.n_unseen += usize::from(behind > 0.0);
    }
}

/// Coefficients in, radiance out.
pub trait Relight {
    /// Takes over the blocks `changed` (group, block) of `frame`; everything, where the shape of the frame is new.
    ///
    /// # Errors
    /// [`RelightError::Frame`] or [`RelightError::Block`] for factors that do not fit; the previous frame stays. After an
    /// error of the device, make a new relighter.
    fn update(&mut self, frame: &Frame, changed: &[(usize, usize)]) -> Result<(), RelightError>;

    /// Fills `out` with the picture under `coefficients`: one slice per group, one RGB triple per column.
    ///
    /// # Errors
    /// Wrong lengths, coefficients that are not finite, a failing device.
    fn relight(&mut self, coefficients: &[Vec<[f32; 3]>], out: &mut Radiance) -> Result<(), RelightError>;

    /// Takes radiance that is added to every picture from now on, whatever the coefficients are; none takes it away. The
    /// same layer again costs nothing. A frame of another shape starts without one.
    ///
    /// # Errors
    /// [`RelightError::LayerSize`] or [`RelightError::LayerNotFinite`], and then the layer before stays; a failing device.
    fn set_layer(&mut self, layer: Option<&Arc<Radiance>>) -> Result<(), RelightError>;

    /// What the last relight did.
    fn stats(&self) -> RelightStats;
}

/// One finite coefficient per column of every group, or the error that says which is not.
pub(crate) fn check_coefficients(frame: &Frame, coefficients: &[Vec<[f32; 3]>]) -> Result<(), RelightError> {
    if coefficients.len() != frame.groups.len() {
        return Err(RelightError::GroupCount { expected: frame.groups.len(), found: coefficients.len() });
    }
    for (group, (low_rank, x)) in frame.groups.iter().zip(coefficients).enumerate() {
        let expected = low_rank.n_cols as usize;
        if x.len() != expected {
            return Err(RelightError::ColumnCount { group, expected, found: x.len() });
        }
        if let Some(col) = x.iter().position(|rgb| rgb.iter().any(|v| !v.is_finite())) {
            return Err(RelightError::NotFinite { group, col });
        }
    }
    Ok(())
}

/// A layer that fits the frame, or the error that says why it does not.
pub(crate) fn check_layer(frame: &Frame, layer: &Radiance) -> Result<(), RelightError> {
    let (expected, found) = ([frame.width, frame.height], [layer.width, layer.height]);
    if expected != found || layer.pixels.len() != frame.width as usize * frame.height as usize {
        return Err(RelightError::LayerSize { expected, found });
    }
    let broken = layer.pixels.par_iter().position_first(|rgb| rgb.iter().any(|v| !v.is_finite()));
    broken.map_or(Ok(()), |pixel| Err(RelightError::LayerNotFinite { pixel }))
}

/// Whether two layers are one and the same, not only alike.
pub(crate) fn is_same_layer(a: Option<&Arc<Radiance>>, b: Option<&Arc<Radiance>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// Whether every coefficient is zero, so that the group adds nothing.
pub(crate) fn is_dark(coefficients: &[[f32; 3]]) -> bool {
    coefficients.iter().all(|rgb| *rgb == [0.0; 3])
}
