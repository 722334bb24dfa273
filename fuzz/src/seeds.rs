//! Small valid files, a few for each target.

use super::targets::glb;

/// Names of the targets.
pub const TARGETS: [&str; 8] = ["gltf", "meshopt", "photometry", "sky", "picture", "archive", "look", "wishes"];

const RICH_JSON: &[u8] = include_bytes!("../seeds/rich.json");
const RICH_BIN: &[u8] = include_bytes!("../seeds/rich.bin");

/// Valid files for a target.
pub fn of(target: &str) -> Vec<Vec<u8>> {
    let files: &[&[u8]] = match target {
        "gltf" => {
            // The last one has what is refused beside what is read: Draco, KTX2; WebP, JPEG, sparse accessors.
            let plain = include_bytes!("../../crates/editor/tests/room.gltf");
            return vec![plain.to_vec(), glb(RICH_JSON, RICH_BIN), include_bytes!("../seeds/odd.gltf").to_vec()];
        }
        "meshopt" => return meshopt(),
        "photometry" => &[include_bytes!("../seeds/lamp.ies"), include_bytes!("../seeds/lamp.ldt")],
        "sky" => &[
            include_bytes!("../seeds/sky.hdr"),
            include_bytes!("../seeds/flat.hdr"),
            include_bytes!("../seeds/sky.exr"),
        ],
        "picture" => &[
            include_bytes!("../seeds/flat.hdr"),
            include_bytes!("../seeds/sky.exr"),
            include_bytes!("../seeds/light.png"),
        ],
        "archive" => &[
            include_bytes!("../../crates/transport/tests/data/v1.transport"),
            include_bytes!("../../crates/transport/tests/data/v2.transport"),
            include_bytes!("../../crates/transport/tests/data/v3.transport"),
            include_bytes!("../../crates/transport/tests/data/v4.transport"),
            include_bytes!("../../crates/transport/tests/data/v5.transport"),
            include_bytes!("../../crates/transport/tests/data/v6.transport"),
            include_bytes!("../../crates/transport/tests/data/v7.transport"),
            include_bytes!("../../crates/transport/tests/data/v8.transport"),
            include_bytes!("../../crates/transport/tests/data/v9.transport"),
        ],
        "look" => &[include_bytes!("../seeds/rich.look"), include_bytes!("../seeds/kept.look")],
        "wishes" => &[include_bytes!("../seeds/all.wishes")],
        _ => &[],
    };
    files.iter().map(|file| file.to_vec()).collect()
}

/// Streams of attributes, indices and triangles behind the bytes that choose how they are read.
fn meshopt() -> Vec<Vec<u8>> {
    // 16 elements of 12 bytes; every group of differences is stored raw.
    let mut attributes = vec![0, 12, 16, 0, 0xA0];
    for byte in 0..12u8 {
        attributes.push(3);
        attributes.extend((0..16).map(|nth: u8| nth.wrapping_mul(byte)));
    }
    attributes.extend([0; 20]);
    attributes.extend([1; 12]);
    let octahedral = [&[3, 4][..], &attributes[2..4], &attributes[4..5 + 17 * 4], &[0; 32]].concat();
    let mut indices = vec![2, 4, 9, 0, 0xD1];
    indices.extend([2, 4, 6, 2, 4, 130, 1, 4, 6]);
    indices.extend([0; 4]);
    let mut triangles = vec![1, 2, 6, 0, 0xE1, 0xF0, 0x10];
    triangles.extend([0; 16]);
    vec![attributes, octahedral, indices, triangles]
}
