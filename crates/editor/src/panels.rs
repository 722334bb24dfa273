//! The panels around the picture: free functions that edit the look in place and push requests.

pub mod arrows;
pub mod bake;
pub mod camera;
pub mod color;
pub mod dialogs;
pub mod display;
pub mod export;
pub mod heat;
pub mod lamps;
pub mod lights;
pub mod looks;
pub mod measure;
pub mod menu;
pub mod messages;
pub mod number;
pub mod plot;
pub mod shortcuts;
pub mod sight;
pub mod sky;
pub mod solve;
pub mod spots;
pub mod status;
pub mod strip;
pub mod toolbar;
