//! The opened scene as a glTF file with its lights as they are set, so that opening it shows the same picture.
//!
//! Only what says how something shines is written anew. Everything else is taken over as it was read, byte for byte, with
//! extensions that this program does not know: an importer that wrote out what it understood would lose the rest.

mod container;
mod emission;
mod lamps;
mod lights;
mod muted;
mod raw;
mod shared;

use std::path::Path;

use anyhow::{Context, Result};
use clerestory_transport::prepared::PreparedScene;

use crate::look::Look;
pub use container::{BIN, write_glb};
use container::{Container, Kind};
use raw::Document;

/// A scene that is open, and the file that it was read from.
pub struct Lit<'a> {
    /// The file.
    pub bytes: &'a [u8],
    /// Folder of what the file refers to; none for what came from memory.
    pub folder: Option<&'a Path>,
    /// The scene, with its lights.
    pub scene: &'a PreparedScene,
    /// How it is lit.
    pub look: &'a Look,
}

impl Lit<'_> {
    /// Writes a `.glb` or `.gltf` file, and files beside it where the source has them. Answers a sentence for each thing that the
    /// format cannot hold.
    ///
    /// # Errors
    /// If the source is damaged, a lamp cannot shine, or a place cannot be written.
    pub fn save(&self, path: &Path) -> Result<Vec<String>> {
        let kind = Kind::of(path)?;
        let source = Container::split(self.bytes).context("the scene cannot be read again")?;
        let mut document = Document::parse(source.json).context("the scene cannot be read again")?;
        let mut warnings = lights::write(&mut document, self.scene, &self.look.lights)?;
        lamps::write(&mut document, self.scene, &self.look.lights, &mut warnings)?;
        container::save(&source, document, kind, self.folder, path)?;
        Ok(warnings.iter().map(|words| self.look.renamed(words)).collect())
    }
}

#[cfg(test)]
mod tests;
