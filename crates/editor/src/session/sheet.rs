//! The contact sheet of looks that were kept, made beside the window.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, ensure};
use clerestory_transport::basis::LightBasis;
use clerestory_transport::camera::Film;

use super::task::Post;
use crate::black::{black_words, is_black};
use crate::contact_sheet::{Print, check_size, write_sheet};
use crate::export::{ExportOptions, ImageFormat, Picture};
use crate::look::Units;
use crate::look::snapshot::Snapshot;
use crate::output::PendingFile;
use crate::stills::{Size, Stills, Subject};

/// Widest picture on a sheet, pixels.
const WIDTH_PX: u32 = 960;

/// Writes the sheet and says so, unless it is no longer wanted.
pub(super) fn write(snapshots: &[Snapshot], subject: Subject, path: &Path, post: &Post) {
    let header = subject.bake.header.clone();
    let written = sheet(snapshots, subject, path, &|| !post.is_wanted());
    post.written(written.map(|black| match black {
        Some(black) => {
            (format!("Saved {} looks on {}", snapshots.len(), path.display()), warning(&black, &header.basis))
        }
        None => (format!("{} was not saved", path.display()), None),
    }));
}

/// Names of the looks whose pictures are black although lights are on; `None` if it was stopped.
fn sheet<'a>(
    snapshots: &'a [Snapshot],
    subject: Subject,
    path: &Path,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Option<Vec<&'a str>>> {
    ensure!(ImageFormat::of(path)? == ImageFormat::Png, "a contact sheet is a .png; change the name of the file");
    let place = PendingFile::create(path)?;
    let (header, size) = (subject.bake.header.clone(), Size::Within(WIDTH_PX));
    let mut stills = Stills::new(Arc::new(subject), None);
    let Film { width, height } = stills.film(size);
    check_size(snapshots.len(), [width, height])?;
    let (mut prints, mut black) = (Vec::new(), Vec::new());
    for snapshot in snapshots {
        let mut look = snapshot.look();
        let (irradiance, display) = stills.arriving(&look, size, stop)?;
        look.display = display;
        let Some(radiance) = stills.picture(&look, size, stop)? else { return Ok(None) };
        let picture = Picture {
            radiance: &radiance,
            layers: &[],
            irradiance: irradiance.as_ref(),
            look: &look,
            units: Units::of(&header.basis),
        };
        let (picture, _) = picture.developed(&ExportOptions::default())?;
        prints.push(Print { name: snapshot.name.clone(), picture });
        if is_black(&radiance, &header.basis, &look.lights) {
            black.push(snapshot.name.as_str());
        }
    }
    write_sheet(&prints, place)?;
    Ok(Some(black))
}

/// What is said of looks whose pictures are black.
fn warning(black: &[&str], basis: &LightBasis) -> Option<String> {
    match black {
        [] => None,
        [name] => Some(black_words(&format!("the picture of {name} is"), basis)),
        names => Some(black_words(&format!("the pictures of {} are", names.join(", ")), basis)),
    }
}
