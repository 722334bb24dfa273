//! Which channels of an OpenEXR file are its picture.

use exr::meta::header::Header;
use exr::prelude::Text;

/// Layers that are looked at for colors of their own.
const MAX_LAYERS: usize = 256;

/// Names of the channels of a picture.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Channels {
    /// Red, green and blue.
    Color([Text; 3]),
    /// X, Y and Z of CIE 1931.
    Xyz([Text; 3]),
    /// Luminance alone.
    Gray(Text),
}

/// The first part with a picture, and its channels: R, G and B, else Y without X and Z, else a layer in color, first of all one that
/// Blender names `Combined`, else X, Y and Z. Small letters will do.
///
/// # Errors
/// The channels that there are, or that a part is deep, in words.
pub(super) fn of_picture(headers: &[Header]) -> Result<(&Header, Channels), String> {
    // The decoder reads no flat part beside a deep one either.
    if headers.iter().any(|header| header.deep) {
        return Err("it is deep, with any number of samples in a pixel, which cannot be read; save it flattened".into());
    }
    let plain = headers.iter().find_map(|header| Some((header, in_color(header, b"")?)));
    let gray = headers.iter().find_map(|header| Some((header, in_gray(header)?)));
    let layer = || {
        let layers = || headers.iter().flat_map(|header| prefixes(header).map(move |prefix| (header, prefix)));
        let combined = layers().filter(|(_, prefix)| prefix.ends_with(b"Combined."));
        let mut layers = combined.chain(layers()).take(MAX_LAYERS);
        layers.find_map(|(header, prefix)| Some((header, in_color(header, prefix)?)))
    };
    let xyz = || headers.iter().find_map(|header| Some((header, in_xyz(header)?)));
    if let Some(found) = plain.or(gray).or_else(layer).or_else(xyz) {
        return Ok(found);
    }
    if headers.iter().any(|header| named(header, b"RY").is_some()) {
        return Err("it holds luminance and chroma apart; save it with channels R, G and B".into());
    }
    let names: Vec<String> =
        headers.iter().flat_map(|header| &header.channels.list).take(12).map(|c| c.name.to_string()).collect();
    Err(format!("it has neither channels R, G and B nor Y, but {}", names.join(", ")))
}

fn named(header: &Header, name: &[u8]) -> Option<Text> {
    let names = || header.channels.list.iter().map(|channel| &channel.name);
    let exact = names().find(|own| own.as_slice() == name);
    exact.or_else(|| names().find(|own| own.as_slice().eq_ignore_ascii_case(name))).cloned()
}

fn in_color(header: &Header, prefix: &[u8]) -> Option<Channels> {
    let channel = |color: &[u8]| named(header, &[prefix, color].concat());
    Some(Channels::Color([channel(b"R")?, channel(b"G")?, channel(b"B")?]))
}

fn in_gray(header: &Header) -> Option<Channels> {
    let has_chroma = named(header, b"RY").is_some();
    named(header, b"Y").filter(|_| !has_chroma && in_xyz(header).is_none()).map(Channels::Gray)
}

fn in_xyz(header: &Header) -> Option<Channels> {
    Some(Channels::Xyz([named(header, b"X")?, named(header, b"Y")?, named(header, b"Z")?]))
}

/// What stands before the R of layers, great or small, with the dot that ends it.
fn prefixes(header: &Header) -> impl Iterator<Item = &[u8]> {
    let names = header.channels.list.iter().map(|channel| channel.name.as_slice());
    let before_red = names.filter_map(|name| name.strip_suffix(b"R").or_else(|| name.strip_suffix(b"r")));
    before_red.filter(|prefix| prefix.ends_with(b"."))
}
