//! An image that nothing of a scene samples, as exporters leave them behind.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};

/// Pixels of a side of the image.
pub(super) const SIDE: u32 = 2048;
const IMAGE: &str = "idle.png";
/// Of the binary container: its header, and that of its first chunk, which is JSON.
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;

/// Writes a copy of a binary glTF file, with an image beside it: light of the first material that gives off none has it as texture.
///
/// # Errors
/// If the file cannot be read or written, is no binary glTF file, or has no such material.
pub(super) fn copy(scene: &Path, to: &Path) -> Result<()> {
    let cannot = || format!("cannot add an image to {}", scene.display());
    let bytes = fs::read(scene).with_context(cannot)?;
    ensure!(bytes.starts_with(b"glTF"), "{} is no binary glTF file", scene.display());
    let (head, rest) = bytes.split_at_checked(HEADER_BYTES + CHUNK_HEADER_BYTES).with_context(cannot)?;
    let length = head.get(HEADER_BYTES..).and_then(|chunk| chunk.first_chunk::<4>()).with_context(cannot)?;
    let (document, binary) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).with_context(cannot)?;
    let mut document: Value = serde_json::from_slice(document).with_context(cannot)?;
    let image = pushed(&mut document["images"], json!({ "uri": IMAGE }))?;
    let texture = pushed(&mut document["textures"], json!({ "source": image }))?;
    let materials = document["materials"].as_array_mut().with_context(cannot)?;
    let mut dark = materials.iter_mut().filter(|material| material.get("emissiveFactor").is_none());
    dark.next().with_context(cannot)?["emissiveTexture"] = json!({ "index": texture });

    let mut document = serde_json::to_vec(&document)?;
    document.resize(document.len().next_multiple_of(4), b' ');
    let length = HEADER_BYTES + CHUNK_HEADER_BYTES + document.len() + binary.len();
    let mut copy = head.to_vec();
    copy.splice(8..12, u32::try_from(length)?.to_le_bytes());
    copy.splice(12..16, u32::try_from(document.len())?.to_le_bytes());
    copy.extend(document);
    copy.extend(binary);
    fs::write(to, copy).with_context(cannot)?;
    let shade = |x: u32, y: u32| Rgb([x, y, x.wrapping_mul(y)].map(|value| (value & 255) as u8));
    RgbImage::from_fn(SIDE, SIDE, shade).save(to.with_file_name(IMAGE)).with_context(cannot)
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
        let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/diffuse.glb");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("copy.glb");
        copy(&scene, &path).unwrap();
        let [skipped, decoded] = [Skips::default(), Skips::none()].map(|skips| {
            let scene = import::load_with(&path, skips).unwrap().scene;
            (scene.idle_images, scene.idle_bytes, scene.mesh.triangles.len())
        });
        assert_eq!((skipped.0, skipped.1), (1, 4 * u64::from(SIDE * SIDE)));
        assert_eq!((decoded.0, decoded.2), (0, skipped.2));
    }
}
