//! Over files of other hands, where `CLERESTORY_SHARED` names their folder.

use std::path::{Path, PathBuf};

use glam::{Vec2, Vec3};

use crate::import::{ImportError, Imported, load};
use crate::laws::at_hand;
use crate::scene::Finish;

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a readable folder").map(|entry| entry.expect("an entry").path()) {
        match entry.extension().and_then(|extension| extension.to_str()) {
            _ if entry.is_dir() => files.extend(files_below(&entry)),
            Some("glb" | "gltf") => files.push(entry),
            _ => {}
        }
    }
    files.sort();
    files
}

fn conformance(shared: &Path, file: &str) -> Imported {
    load(&shared.join("conformance").join(file)).expect(file)
}

#[test]
fn every_conformance_file_loads_or_says_why_not() {
    let Some(shared) = at_hand::folder() else { return };
    let files = files_below(&shared.join("conformance"));
    assert!(files.len() > 50, "{}", files.len());
    for file in files {
        let in_words = file.to_string_lossy().into_owned();
        match load(&file) {
            Ok(Imported { scene, .. }) => {
                let n_vertices = scene.mesh.positions.len();
                assert_eq!(scene.mesh.normals.len(), n_vertices, "{in_words}");
                assert!(scene.mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4), "{in_words}");
                assert!(scene.mesh.triangles.iter().flatten().all(|&v| (v as usize) < n_vertices), "{in_words}");
                assert!(scene.mesh.triangle_material.iter().all(|&m| (m as usize) < scene.materials.len()));
                assert_eq!(scene.cameras.is_empty(), scene.mesh.triangles.is_empty(), "{in_words}");
            }
            Err(ImportError::Extension { remedy, .. }) => assert!(remedy.contains("compression"), "{in_words}"),
            Err(ImportError::Json { .. }) => assert!(in_words.contains("malformed"), "{in_words}"),
            Err(error) => panic!("{in_words}: {error}"),
        }
    }
}

#[test]
fn the_table_of_features_has_every_extension_that_is_known() {
    let table = include_str!("../../../../../docs/conformance.md");
    let known = crate::import::extensions::known();
    assert!(known.len() > 20);
    for name in known {
        let short = name.strip_prefix("KHR_materials").unwrap_or(name);
        assert!(table.contains(&format!("`{name}`")) || table.contains(&format!("`{short}`")), "{name} is missing");
    }
}

/// Lines that are told of one file.
const MOST_LINES: usize = 4;

/// A row of the table of files: its place, what it has, and what is said of it.
fn row(folder: &Path, file: &Path) -> String {
    let place = file.strip_prefix(folder).expect("a file below").to_string_lossy().replace('\\', "/");
    let cell = |text: String| text.replace('|', "\\|").replace('\n', " ");
    let Imported { scene, report } = match load(file) {
        Ok(imported) => imported,
        Err(error) => return format!("| {place} | refused | {} |", cell(error.to_string())),
    };
    let lines: Vec<String> = report.unsupported.iter().chain(&report.warnings).cloned().map(cell).collect();
    let more = lines.len().saturating_sub(MOST_LINES);
    let mut told = lines[..lines.len() - more].join("; ");
    if more > 0 {
        told += &format!("; and {more} more");
    }
    let state = match (report.unsupported.is_empty(), report.warnings.is_empty()) {
        (true, true) => "whole",
        (false, true) => "in part",
        (_, false) => "mended",
    };
    format!("| {place} | {state}, {} triangles | {told} |", scene.mesh.triangles.len())
}

#[test]
fn the_table_of_files_says_what_becomes_of_each() {
    let Some(shared) = at_hand::folder() else { return };
    let folder = shared.join("conformance");
    let rows: Vec<String> = files_below(&folder).iter().map(|file| row(&folder, file)).collect();
    let table = rows.join("\n");
    let page = include_str!("../../../../../docs/conformance.md");
    if !page.contains(&table) {
        let written = std::env::temp_dir().join("conformance-files.md");
        std::fs::write(&written, format!("{table}\n")).expect("a folder for temporary files");
        panic!("docs/conformance.md has another table of files; what it should be is in {}", written.display());
    }
}

#[test]
fn triangle_counts_are_those_of_the_files() {
    let Some(shared) = at_hand::folder() else { return };
    for (file, n_triangles) in [
        ("NegativeScaleTest/NegativeScaleTest.glb", 7724),
        ("SimpleSparseAccessor/SimpleSparseAccessor.gltf", 12),
        ("BoxInterleaved/BoxInterleaved.glb", 12),
        ("VertexColorTest/VertexColorTest.glb", 36),
        ("Duck-Quantized/Duck.gltf", 4212),
        ("atteneder-NoScene/NoScene.gltf", 12),
        ("atteneder-Empty/Empty.gltf", 0),
        ("SimpleInstancing/SimpleInstancing.glb", 12 * 125),
        ("BoxMeshopt/BoxMeshopt.glb", 12),
        ("BoxMeshopt-gltf/BoxMeshopt.gltf", 12),
        // Its buffer is a stub of a version control system.
        ("atteneder-RainbowCuboid-meshopt-cc-vpn/RainbowCuboid-meshopt-cc-vpn.gltf", 0),
        ("malformed/assimp-AllIndicesOutOfRange/AllIndicesOutOfRange.gltf", 0),
        ("malformed/assimp-BoxWithInfinites/BoxWithInfinites.glb", 0),
        ("malformed/assimp-BoxBadNormals/BoxBadNormals.glb", 12),
    ] {
        assert_eq!(conformance(&shared, file).scene.mesh.triangles.len(), n_triangles, "{file}");
    }
}

#[test]
fn fronts_of_mirrored_nodes_agree_with_their_normals() {
    let Some(shared) = at_hand::folder() else { return };
    let mesh = conformance(&shared, "NegativeScaleTest/NegativeScaleTest.glb").scene.mesh;
    let agrees = |t: &u32| {
        let normal: Vec3 = mesh.triangles[*t as usize].iter().map(|&v| mesh.normals[v as usize]).sum();
        normal.dot(mesh.area_normal(*t)) > 0.0
    };
    let n_agreeing = (0..mesh.triangles.len() as u32).filter(agrees).count();
    assert!(n_agreeing as f32 > 0.999 * mesh.triangles.len() as f32, "{n_agreeing} of {}", mesh.triangles.len());
}

#[test]
fn attributes_of_the_samples_arrive() {
    let Some(shared) = at_hand::folder() else { return };
    let two_sets = conformance(&shared, "MultiUVTest/MultiUVTest.glb").scene;
    assert!(two_sets.mesh.uvs.iter().all(|uvs| uvs.len() == two_sets.mesh.positions.len()));
    let colored = conformance(&shared, "BoxVertexColors/BoxVertexColors.glb").scene.mesh;
    assert!(colored.colors.iter().any(|color| color.truncate().max_element() < 0.9 || color.truncate() != Vec3::ONE));
    let modes = conformance(&shared, "MeshPrimitiveModes/MeshPrimitiveModes.gltf");
    assert_eq!(modes.report.unsupported.iter().filter(|line| line.contains("points and lines")).count(), 4);
    let duck = conformance(&shared, "Duck-Quantized/Duck.gltf").scene;
    let (lo, hi) = duck.mesh.bounds().expect("a duck");
    assert!((0.5..5.0).contains(&(hi - lo).max_element()), "{lo} to {hi}");
    let placed = duck.materials[0].base_color_texture.expect("a yellow duck");
    assert!(duck.mesh.uvs[0].iter().all(|&uv| {
        let uv = placed.transform.transform_point2(uv);
        uv.cmpgt(Vec2::splat(-0.01)).all() && uv.cmplt(Vec2::splat(1.01)).all()
    }));
}

#[test]
fn lamps_cameras_and_images_of_the_samples_arrive() {
    let Some(shared) = at_hand::folder() else { return };
    assert_eq!(conformance(&shared, "LightsPunctualLamp/LightsPunctualLamp.gltf").scene.punctual.len(), 5);
    let cameras = conformance(&shared, "Cameras/Cameras.gltf");
    assert_eq!((cameras.scene.cameras.len(), cameras.report.n_cameras), (1, 2));
    assert!(cameras.report.unsupported[0].contains("perspective"));
    let spaces = conformance(&shared, "Box With Spaces/Box With Spaces.gltf");
    assert_eq!((spaces.scene.textures.len(), spaces.report.warnings.len()), (3, 0), "{:?}", spaces.report.warnings);
    let moved = conformance(&shared, "TextureTransformTest/TextureTransformTest.gltf").scene;
    let transforms = moved.materials.iter().filter_map(|material| material.base_color_texture);
    assert!(transforms.filter(|texture| texture.transform != glam::Affine2::IDENTITY).count() >= 5);
    let basis = conformance(&shared, "StainedGlassLamp-KTX-BasisU/StainedGlassLamp.gltf");
    assert!(basis.report.warnings.iter().any(|line| line.contains("KTX2")));
}

#[test]
fn compressed_views_hold_what_their_accessors_state() {
    let Some(shared) = at_hand::folder() else { return };
    let cube = conformance(&shared, "BoxMeshopt/BoxMeshopt.glb").scene.mesh;
    let (lo, hi) = cube.bounds().expect("a box");
    assert!((hi - lo - Vec3::ONE).abs().max_element() < 1e-3, "{lo} to {hi}");
    let straight = |t: u32| cube.normals[cube.triangles[t as usize][0] as usize].dot(cube.area_normal(t).normalize());
    assert!((0..12).all(|t| straight(t) > 0.999), "normals of a box stand on its faces");

    let Imported { scene, report } = load(&shared.join("scenes/dream-apartment-meshopt.glb")).expect("an apartment");
    assert_eq!((scene.mesh.triangles.len() + report.n_degenerate_triangles, report.warnings.len()), (177_934, 0));
    let (lo, hi) = scene.mesh.bounds().expect("an apartment");
    // The smallest and largest corners that the file states for its 67 parts.
    let (known_lo, known_hi) = (Vec3::new(0.44376, -0.09928, -11.43372), Vec3::new(12.80558, 2.68052, -0.12999));
    assert!((lo - known_lo).abs().max_element() < 1e-4 && (hi - known_hi).abs().max_element() < 1e-4, "{lo} to {hi}");
    assert!(scene.mesh.normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-3));
}

#[test]
fn finishes_of_the_samples_arrive() {
    let Some(shared) = at_hand::folder() else { return };
    let finishes = |file: &str| -> Vec<Finish> {
        let Imported { scene, report } = conformance(&shared, file);
        let left_out =
            report.unsupported.iter().find(|line| line.contains("KHR_materials") && !line.contains("variants"));
        assert_eq!(left_out, None, "{file}");
        scene.materials.into_iter().filter_map(|material| material.finish).map(|finish| *finish).collect()
    };
    let coats = finishes("ClearCoatTest/ClearCoatTest.glb");
    assert!(coats.len() >= 5 && coats.iter().all(|finish| finish.clearcoat > 0.0));
    assert!(coats.iter().any(|finish| finish.clearcoat_normal_texture.is_some()));
    assert!(finishes("SheenChair/SheenChair.gltf").iter().any(|finish| finish.sheen_color != Vec3::ZERO));
    assert!(finishes("IridescenceSuzanne/IridescenceSuzanne.glb").iter().any(|finish| finish.iridescence > 0.0));
    // Its maps are all KTX2, and what they would scale is left out with them.
    let lamp = finishes("AnisotropyBarnLamp-KTX2-Basisu/AnisotropyBarnLamp.gltf");
    assert!(lamp.iter().all(|finish| finish.anisotropy == 0.0));
}
