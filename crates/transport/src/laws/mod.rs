//! Laws of light transport, on scenes small enough for their answer to be known by hand or by brute force.

mod caustics;
mod close;
mod columns;
mod cutoffs;
mod deadline;
mod denoise;
mod estimators;
mod finishes;
mod glazing;
mod irradiance;
mod leaks;
mod panes;
mod patches;
mod pictures;
mod rebake;
mod reconstructions;
mod reference;
mod reuse;
mod shadows;
mod sharing;
mod skips;
mod sky;
pub(crate) mod slabs;
pub(crate) mod stage;
mod stopped;
mod suns;
mod walks;
