//! House tests: what the four crates promise together. One binary; this file is its table of contents.

#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by a panic and says what it skips")]

/// The arrows between the crates, and one version of what must be one.
mod architecture;
/// Sums that must not wrap in silence where files are read.
mod checked;
/// What a scene is warned of before anybody looks for light that is not there.
mod doubts;
/// Scenes whose radiance is known by hand: closed spheres and furnaces.
mod energy;
/// Numbers at the ends of what they can be.
mod extremes;
/// Files from strangers: mutated by the thousand, none brings the house down.
mod hostile;
/// Lux: of what is seen, and of sensor grids.
mod irradiance;
/// Lamps of a look: moved, added, and traced.
mod lamps;
/// Light adds up.
mod linearity;
/// Variants, and what rough metal loses.
mod materials;
/// A picture for each light in, any light out.
mod measured;
/// glTF in, EXR out, through the command line.
mod pipeline;
/// Forty powers of ten of light through every stage behind a bake.
mod ranges;
/// Columns of an earlier bake, taken over.
mod rebake;
/// `trace` against pictures that another renderer made.
mod references;
/// The sky: turned, exchanged, in patches and sharp behind the picture.
mod sky;
/// Scenes, statistics, and devices for all of the above.
mod support;
/// Two ways to one answer: tracing and relighting, CPU and GPU.
mod twins;
/// Unlit surfaces: seen, and no obstacle to light.
mod unlit;
