//! Laws of the import: over glTF written here, over broken files, and over the shared conformance files.

mod broken;
mod conformance;
mod fixture;
mod geometry;
mod idle;
mod muted;
mod profiles;
mod scenes;
mod skins;
mod surfaces;
