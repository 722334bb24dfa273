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

/// More lines than anyone reads.
const MAX_LINES: usize = 100;
/// Lines of one reason, so that a thousand nodes with the same fault leave room for another one.
const MAX_OF_A_KIND: usize = 25;

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
    if lines.contains(&line) {
        return;
    }
    let n_alike = lines.iter().filter(|other| reason(other) == reason(&line)).count();
    let line = if n_alike < MAX_OF_A_KIND { line } else { format!("others: {}", reason(&line)) };
    if lines.len() == MAX_LINES {
        lines.push(MORE.to_owned());
    }
    if lines.len() < MAX_LINES && !lines.contains(&line) {
        lines.push(line);
    }
}

/// A line without what it is about.
fn reason(line: &str) -> &str {
    line.split_once(": ").map_or(line, |(_, reason)| reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_nodes_with_one_fault_leave_room_for_another() {
        let mut notes = Notes::default();
        (0..1000).for_each(|nth| notes.warn(format!("node {nth}: points and lines are left out")));
        notes.warn("node 7: 3 normals for 4 vertices: they are ignored".to_owned());
        let [first, .., others, last] = notes.warnings.as_slice() else { panic!("{:?}", notes.warnings) };
        assert_eq!(notes.warnings.len(), MAX_OF_A_KIND + 2);
        assert_eq!(
            (first.as_str(), others.as_str()),
            ("node 0: points and lines are left out", "others: points and lines are left out")
        );
        assert!(last.starts_with("node 7: 3 normals"), "{last}");
    }
}
