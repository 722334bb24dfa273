//! The contact sheet of looks that were kept, made beside the window.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Result, ensure};

use super::task::{Fact, Post};
use crate::contact_sheet::{Print, write_sheet};
use crate::export::{ExportOptions, ImageFormat, Picture};
use crate::look::snapshot::Snapshot;
use crate::output::PendingFile;
use crate::stills::{Size, Stills, Subject};
use crate::words::in_words;

/// Widest picture on a sheet, pixels.
const WIDTH_PX: u32 = 960;

/// Writes the sheet and says so, unless it is no longer wanted.
pub(super) fn write(snapshots: &[Snapshot], subject: Subject, path: &Path, post: &Post) {
    let written = sheet(snapshots, subject, path, &|| !post.is_wanted());
    let words = written.map(|n| match n {
        Some(n) => format!("Saved {n} looks on {}", path.display()),
        None => format!("{} was not saved", path.display()),
    });
    let _ = post.send(Fact::Written(words.map_err(|error| in_words(&error))), Duration::ZERO);
}

/// Number of looks that are on the sheet; `None` if it was stopped.
fn sheet(
    snapshots: &[Snapshot],
    subject: Subject,
    path: &Path,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<usize>> {
    ensure!(ImageFormat::of(path)? == ImageFormat::Png, "a contact sheet is a .png; change the name of the file");
    let place = PendingFile::create(path)?;
    let mut stills = Stills::new(Arc::new(subject), None);
    let mut prints = Vec::new();
    for snapshot in snapshots {
        let (mut look, size) = (snapshot.look(), Size::Within(WIDTH_PX));
        let (irradiance, display) = stills.arriving(&look, size, stop)?;
        look.display = display;
        let Some(radiance) = stills.picture(&look, size, stop)? else { return Ok(None) };
        let picture = Picture { radiance: &radiance, layers: &[], irradiance: irradiance.as_ref(), look: &look };
        let (picture, _) = picture.developed(&ExportOptions::default())?;
        prints.push(Print { name: snapshot.name.clone(), picture });
    }
    write_sheet(&prints, place)?;
    Ok(Some(prints.len()))
}
