//! The only room with windows: egui, command line, files, threads, words for people. It holds no physics and no linear
//! algebra; those live in the three crates below, and what passes between them is carried across here.
//!
//! Everything is in this library so that tests can drive it; the binary only calls [`cli::run`].

pub mod action;
pub mod app;
pub mod bake_cache;
mod black;
pub mod cli;
pub mod compare;
pub mod contact_sheet;
pub mod crash;
pub mod export;
pub mod export_gltf;
pub mod headless;
pub mod illuminance;
pub mod isolux;
pub mod legend;
pub mod lettering;
pub mod look;
pub mod marks;
pub mod output;
pub mod panels;
pub mod picture;
pub mod platform;
pub mod pulse;
pub mod room;
pub mod schedule;
pub mod sequence;
pub mod session;
pub mod sizes;
pub mod solve;
pub mod stills;
#[cfg(test)]
mod support;
pub mod table;
pub mod theme;
pub mod unsaved;
pub mod viewport;
pub mod words;
