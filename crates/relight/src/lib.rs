//! Multiplies a compressed light transport matrix with the coefficients of its columns, and brings the result to the
//! display.
//!
//! Rows are the color channels of pixels (`3 · pixel + channel`), columns are basis lights in several groups. Each group
//! is a [`BlockLowRank`](clerestory_nystrom::BlockLowRank) over the same tiles, and every tile is
//! `left · diag(scale) · right + sparse`, so a picture takes two thin products per tile:
//!
//! - *project*: `z = scale · right · x`, a few numbers per tile;
//! - *expand*: `radiance = left · z + sparse · x`, which reads every left factor once and is bound by memory.
//!
//! *Display* then applies exposure, white balance, a tone curve and the sRGB encoding, or false color. Each stage exists twice under the same name: as
//! WGSL in `shaders/`, and in Rust. The CPU twin defines the answer ([`CpuRelighter`]); the GPU is right when it agrees
//! ([`GpuRelighter`]). The crate borrows the device of its host, opens no window and knows no scene. Direct light of lamps that no bake
//! knew is traced on the device as well ([`gpu::Lamplight`]), through words that its host packs; the twin of that is the host's.
//!
//! Decided: factors stay f16 on both sides for what is written, and become bytes where a block's own error hides it for what is looked at
//! ([`Precision`]), since the product is bound by memory. Sums over segments of columns are
//! kept, so that one light of many reads its own segment alone. Refused: updating `z` by the difference of two coefficients,
//! because the picture would then depend on the path a slider took.
//!
//! ```
//! use clerestory_relight::{CpuRelighter, Radiance, Relight, synthetic};
//!
//! let frame = synthetic::Recipe { width: 20, height: 10, n_cols: vec![4, 1], ..Default::default() }.frame();
//! let mut relighter = CpuRelighter::new(&frame)?;
//! let mut radiance = Radiance::default();
//! relighter.relight(&[vec![[1.0; 3]; 4], vec![[0.0; 3]]], &mut radiance)?;
//! assert_eq!(radiance.pixels.len(), 200);
//! # Ok::<(), clerestory_relight::RelightError>(())
//! ```

pub mod bandwidth;
pub mod cpu;
pub mod display;
pub mod frame;
pub mod gpu;
mod layout;
pub mod packing;
pub mod relight;
pub mod rows;
pub mod synthetic;

pub use cpu::CpuRelighter;
pub use display::{DisplayParams, Tone, encode, encode_as, encode_into};
pub use frame::{Frame, Radiance};
pub use gpu::{DeviceChoice, Gpu, GpuRelighter};
pub use packing::Precision;
pub use relight::{Relight, RelightError, RelightStats};
pub use rows::{mean_row, weighed_row};
