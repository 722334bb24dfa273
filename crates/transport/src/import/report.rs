//! What people are told about a file.

use std::path::PathBuf;

use serde::Serialize;

/// What an import found, and what it could not use, in plain words.
#[derive(Serialize, Clone, Debug, Default, PartialEq, Eq)]
pub struct ImportReport {
    /// Features of the file that are not shown, one line each.
    pub unsupported: Vec<String>,
    /// Faults of the file and what was done about them, one line each.
    pub warnings: Vec<String>,
    /// Nodes in the file.
    pub n_nodes: usize,
    /// Meshes in the file.
    pub n_meshes: usize,
    /// Cameras in the file.
    pub n_cameras: usize,
    /// Materials in the file.
    pub n_materials: usize,
    /// Images in the file.
    pub n_images: usize,
    /// Punctual lamps in the file.
    pub n_punctual: usize,
    /// Measured light distributions that lamps of the file use.
    pub n_profiles: usize,
    /// Triangles without area that were left out.
    pub n_degenerate_triangles: usize,
    /// Variants of the file that can be chosen instead of what it shows by default.
    pub variants: Vec<String>,
    /// Whether the scene's only camera is one that was made, as the file has none that can be used.
    pub made_camera: bool,
    /// Files beside it that it refers to: buffers, images, light profiles; there or not.
    #[serde(skip)]
    pub files: Vec<PathBuf>,
}

/// Lines for the report while it grows; a line that is already there is not repeated.
#[derive(Debug, Default)]
pub(super) struct Notes {
    pub unsupported: Vec<String>,
    pub warnings: Vec<String>,
}

/// More lines than anyone reads; the rest is counted.
const MAX_LINES: usize = 100;

impl Notes {
    /// A fault of the file and what happens.
    pub fn warn(&mut self, line: String) {
        push_once(&mut self.warnings, line);
    }

    /// A feature that is not shown.
    pub fn unsupported(&mut self, line: String) {
        push_once(&mut self.unsupported, line);
    }

    /// Takes over the lines of another.
    pub fn absorb(&mut self, other: Notes) {
        other.unsupported.into_iter().for_each(|line| self.unsupported(line));
        other.warnings.into_iter().for_each(|line| self.warn(line));
    }
}

fn push_once(lines: &mut Vec<String>, line: String) {
    const MORE: &str = "there is more of this kind, which is not listed";
    if lines.len() == MAX_LINES {
        lines.push(MORE.to_owned());
    }
    if lines.len() < MAX_LINES && !lines.contains(&line) {
        lines.push(line);
    }
}
