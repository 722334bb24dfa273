//! Wishes from a file.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use clerestory_relight::Tone;
use clerestory_transport::bake::Bake;
use clerestory_transport::camera::Film;
use clerestory_transport::prepared::PreparedScene;
use serde::Deserialize;

use super::{Exposure, Freedom, Place, Request, Target, TargetPicture, Wish};
use crate::marks::{Kin, Marks, Seen};
use crate::words::unmarked;

/// Longest file of wishes.
const MAX_BYTES: u64 = 1 << 20;

/// A file of wishes.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WishFile {
    wishes: Vec<Entry>,
    lights: Option<Vec<String>>,
    factor: Option<[f64; 2]>,
    /// Most saturation of colors that may change.
    colors: Option<f64>,
    pull: Option<f64>,
    keep: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: Option<String>,
    rect: Option<[f32; 4]>,
    surface: Option<String>,
    material: Option<String>,
    sensors: Option<String>,
    lux: Option<f64>,
    cd_m2: Option<f64>,
    times: Option<f64>,
    #[serde(default)]
    keep: bool,
    #[serde(rename = "match")]
    picture: Option<PathBuf>,
    exposure: Option<f64>,
    tone: Option<Tone>,
    weight: Option<f64>,
}

/// What wishes are about.
pub struct Surroundings<'a> {
    /// The bake.
    pub bake: &'a Bake,
    /// Its scene and what its pixels see, for surfaces by name.
    pub seen: Option<(&'a PreparedScene, &'a Seen)>,
}

/// Reads the wishes of a file with some text, and pictures that they name beside it.
///
/// # Errors
/// Names the wish that is no wish, and what would be one.
pub fn read(path: &Path, text: &str, of: &Surroundings) -> Result<Request> {
    request(text, path.parent().unwrap_or(Path::new("")), of).with_context(|| format!("cannot use {}", path.display()))
}

/// The pictures that a file of wishes with some text names, where they lie.
///
/// # Errors
/// As [`read`].
pub fn pictures(path: &Path, text: &str) -> Result<Vec<PathBuf>> {
    let file = file_of(text).with_context(|| format!("cannot use {}", path.display()))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    Ok(file.wishes.into_iter().filter_map(|entry| Some(folder.join(entry.picture?))).collect())
}

/// The text of a file of wishes, which a pipe gives but once.
///
/// # Errors
/// If it cannot be read, or is too long.
pub fn text_of(path: &Path) -> Result<String> {
    let (name, mut text) = (path.display(), String::new());
    let file = File::open(path).with_context(|| format!("cannot read {name}: check the path"))?;
    file.take(MAX_BYTES + 1).read_to_string(&mut text).with_context(|| format!("cannot read {name}"))?;
    ensure!(text.len() as u64 <= MAX_BYTES, "{name} is too large for a file of wishes");
    Ok(text)
}

fn file_of(text: &str) -> Result<WishFile> {
    serde_json::from_str(unmarked(text)).context("it is no file of wishes; see the example in docs/cli.md")
}

/// The same from text, with the folder of the pictures.
///
/// # Errors
/// As [`read`].
pub fn request(text: &str, folder: &Path, of: &Surroundings) -> Result<Request> {
    let file = file_of(text)?;
    let usual = Request::default();
    let wishes = file.wishes.into_iter().enumerate();
    let wishes = wishes
        .map(|(idx, entry)| wish(entry, idx, folder, of).with_context(|| format!("wish {}", idx.saturating_add(1))));
    let request = Request {
        wishes: wishes.collect::<Result<_>>()?,
        lights: file.lights,
        bounds: file.factor.unwrap_or(usual.bounds),
        freedom: file.colors.map_or(Freedom::Intensity, |most_saturation| Freedom::Color { most_saturation }),
        pull: file.pull.unwrap_or(usual.pull),
        keep: file.keep.unwrap_or(usual.keep),
    };
    check(&request)?;
    Ok(request)
}

/// Refuses numbers that mean nothing.
///
/// # Errors
/// Names what it has to be.
pub fn check(request: &Request) -> Result<()> {
    let [least, most] = request.bounds;
    ensure!(least >= 0.0 && least <= most && most <= 1e6, "`factor` must be [least, most], from 0 to 1000000");
    ensure!((1e-6..=10.0).contains(&request.pull), "`pull` must be 0.000001 to 10");
    ensure!((0.0..=1e3).contains(&request.keep), "`keep` must be 0 to 1000");
    if let Freedom::Color { most_saturation } = request.freedom {
        ensure!((0.0..=1.0).contains(&most_saturation), "`colors` must be a saturation of 0 to 1");
    }
    Ok(())
}

fn wish(entry: Entry, idx: usize, folder: &Path, of: &Surroundings) -> Result<Wish> {
    let number = |name: &str, value: f64| {
        ensure!((0.0..=1e9).contains(&value), "`{name}` must be 0 to 1000000000");
        Ok(value)
    };
    let mut targets = Vec::new();
    targets.extend(entry.lux.map(|lux| number("lux", lux).map(Target::Illuminance)));
    targets.extend(entry.cd_m2.map(|nit| number("cd_m2", nit).map(Target::Luminance)));
    targets.extend(entry.times.map(|times| number("times", times).map(Target::Times)));
    targets.extend(entry.keep.then_some(Ok(Target::Keep)));
    targets.extend(entry.picture.as_ref().map(|path| picture(&folder.join(path), entry.exposure, entry.tone)));
    let target = match targets.len() {
        1 => targets.remove(0)?,
        _ => bail!("give one of `lux`, `cd_m2`, `times`, `keep` and `match`"),
    };
    let (place, place_name) = place(&entry, of)?;
    let is_match = matches!(target, Target::Picture(..));
    ensure!(!is_match || matches!(place, Place::Whole), "a picture is matched as a whole; leave out the place");
    ensure!(is_match || (entry.exposure.is_none() && entry.tone.is_none()), "`exposure` and `tone` belong to `match`");
    let weight = number("weight", entry.weight.unwrap_or(1.0))?;
    let name = match (entry.name, &target) {
        (Some(name), _) => name,
        (None, Target::Picture(picture, _)) => picture.name.clone(),
        (None, _) => place_name.unwrap_or_else(|| format!("wish {}", idx.saturating_add(1))),
    };
    Ok(Wish { name, place, target, weight })
}

/// A picture to match; how an encoded one was exposed is found, numbers of others (and of a PNG that says how it was shown) are
/// nit unless an exposure is given. A tone curve is taken off an encoded one.
///
/// # Errors
/// If it cannot be read, or has no curve to be taken off.
pub fn picture(path: &Path, exposure_ev: Option<f64>, tone: Option<Tone>) -> Result<Target> {
    if let Some(ev) = exposure_ev {
        ensure!((-60.0..=60.0).contains(&ev), "`exposure` must be -60 to 60 EV");
    }
    let picture = TargetPicture::read(path)?;
    ensure!(
        tone.is_none() || picture.was_encoded(),
        "`tone` changes nothing of {}: its numbers are linear, or it says how it was shown; leave it out",
        path.display()
    );
    Ok(matching(Arc::new(picture), exposure_ev, tone))
}

/// The same of a picture that was read.
pub(super) fn matching(mut picture: Arc<TargetPicture>, exposure_ev: Option<f64>, tone: Option<Tone>) -> Target {
    if let Some(tone) = tone.filter(|tone| picture.was_encoded() && picture.display.tone != *tone) {
        Arc::make_mut(&mut picture).display.tone = tone;
    }
    let exposure = match exposure_ev {
        Some(ev) => Exposure::Ev(ev),
        None if picture.was_encoded() => Exposure::Free,
        None => Exposure::Ev(0.0),
    };
    Target::Picture(picture, exposure)
}

fn place(entry: &Entry, of: &Surroundings) -> Result<(Place, Option<String>)> {
    let header = &of.bake.header;
    let film = Film { width: header.width, height: header.height };
    let mut places = Vec::new();
    if let Some([left, top, right, bottom]) = entry.rect {
        let marks = Marks::rect(film, [[left, top], [right, bottom]]);
        let size = format!("{} × {}", film.width, film.height);
        ensure!(!marks.is_empty(), "`rect` [left, top, right, bottom] holds no pixel of the picture of {size}");
        places.push((Place::Marks(Arc::new(marks)), None));
    }
    for (name, kin, what) in [(&entry.surface, Kin::Node, "node"), (&entry.material, Kin::Material, "material")] {
        let Some(name) = name else { continue };
        let Some((scene, seen)) = of.seen else {
            bail!("surfaces by name need the scene that was baked; name it with --scene");
        };
        let marks = seen.named(scene, name, kin);
        ensure!(!marks.is_empty(), "no {what} that the picture shows is called `{name}`");
        places.push((Place::Marks(Arc::new(marks)), Some(name.clone())));
    }
    if let Some(name) = &entry.sensors {
        let known: Vec<&str> = of.bake.grids().map(|(_, grid)| grid.name.as_str()).collect();
        let found = of.bake.grids().find(|(_, grid)| grid.name == *name);
        let Some((set, _)) = found else {
            bail!(
                "the bake has no sensors `{name}`; it has: {}",
                if known.is_empty() { "none".into() } else { known.join(", ") }
            );
        };
        places.push((Place::Grid(set), Some(name.clone())));
    }
    match places.len() {
        0 => Ok((Place::Whole, None)),
        1 => Ok(places.remove(0)),
        _ => bail!("give one of `rect`, `surface`, `material` and `sensors`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_order_mark_may_stand_before_wishes() {
        let text = r#"{"wishes": [{"lux": 500}]}"#;
        for text in [text.to_owned(), format!("\u{feff}{text}")] {
            let wishes = file_of(&text).unwrap().wishes;
            assert_eq!((wishes.len(), wishes[0].lux), (1, Some(500.0)));
        }
    }
}
