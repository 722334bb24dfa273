//! The window, driven by its labels: one program for all of its tests, so that what they share is compiled and linked once.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails")]

mod bake_panel;
mod basics;
mod board;
mod desk;
mod dialogs;
mod gestures;
mod lamps;
mod lights;
mod looks;
mod numbers;
mod output;
mod sky;
mod solve;
mod view;
