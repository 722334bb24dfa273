//! An image that nothing of a scene samples, as exporters leave them behind.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use clerestory::export_gltf::{BIN, write_glb};
use image::{ImageFormat, Rgb, RgbImage};
use serde_json::{Value, json};

/// Pixels of a side of the image.
const SIDE: u32 = 2048;
/// Of the binary container: its header, and that of each of its two chunks, JSON and bytes.
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// Writes a copy of a binary glTF file with an image more: the light of the first material that gives off none has it as texture.
///
/// # Errors
/// If the file cannot be read or written, is no binary glTF file of two chunks, or has no such material.
pub(super) fn copy(scene: &Path, to: &Path) -> Result<()> {
    let cannot = || format!("cannot add an image to {}", scene.display());
    let bytes = fs::read(scene).with_context(cannot)?;
    ensure!(bytes.starts_with(b"glTF"), "{} is no binary glTF file", scene.display());
    let rest = bytes.get(HEADER_BYTES..).with_context(cannot)?;
    let (document, rest) = chunk(rest).with_context(cannot)?;
    let (binary, _) = chunk(rest).with_context(cannot)?;
    let mut document: Value = serde_json::from_slice(document).with_context(cannot)?;
    let mut binary = binary.to_vec();

    let (png, offset) = (png().with_context(cannot)?, binary.len());
    binary.extend(&png);
    binary.resize(binary.len().next_multiple_of(4), 0);
    document["buffers"][0]["byteLength"] = json!(binary.len());
    let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": png.len() });
    let view = pushed(&mut document["bufferViews"], view)?;
    let image = pushed(&mut document["images"], json!({ "bufferView": view, "mimeType": "image/png" }))?;
    let texture = pushed(&mut document["textures"], json!({ "source": image }))?;
    let materials = document["materials"].as_array_mut().with_context(cannot)?;
    let mut dark = materials.iter_mut().filter(|material| material.get("emissiveFactor").is_none());
    dark.next().with_context(cannot)?["emissiveTexture"] = json!({ "index": texture });

    let mut copy = Vec::new();
    write_glb(&mut copy, serde_json::to_vec(&document)?, &[(BIN, &binary[..])])?;
    fs::write(to, copy).with_context(cannot)
}

/// What a chunk holds, and what stands behind it.
fn chunk(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = u32::from_le_bytes(*bytes.first_chunk()?) as usize;
    bytes.get(CHUNK_HEADER_BYTES..)?.split_at_checked(length)
}

/// A file of the image.
fn png() -> Result<Vec<u8>> {
    let shade = |x: u32, y: u32| Rgb([x, y, x.wrapping_mul(y)].map(|value| (value & 255) as u8));
    let mut file = Cursor::new(Vec::new());
    RgbImage::from_fn(SIDE, SIDE, shade).write_to(&mut file, ImageFormat::Png)?;
    Ok(file.into_inner())
}

/// Adds to an array of a document, which may lack it; where it stands there.
fn pushed(array: &mut Value, value: Value) -> Result<usize> {
    if array.is_null() {
        *array = json!([]);
    }
    let array = array.as_array_mut().context("it is no array")?;
    array.push(value);
    Ok(array.len() - 1)
}

#[cfg(test)]
mod tests {
    use clerestory_transport::import;
    use clerestory_transport::skips::Skips;

    use super::*;

    #[test]
    fn the_image_is_decoded_only_where_nothing_is_skipped() {
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/gallery.glb");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("copy.glb");
        copy(&scene, &path).unwrap();
        let load = |path: &Path, skips: Skips| import::load_with(path, skips).unwrap().scene;
        let [before, skipped, decoded] =
            [(&scene, Skips::default()), (&path, Skips::default()), (&path, Skips::none())]
                .map(|(path, skips)| load(path, skips));
        assert_eq!((before.idle_images, skipped.idle_images, decoded.idle_images), (0, 1, 0));
        assert_eq!(skipped.idle_bytes, 4 * u64::from(SIDE * SIDE));
        assert_eq!(skipped.textures.len(), before.textures.len());
        assert_eq!(decoded.textures.len(), before.textures.len() + 1);
    }
}
