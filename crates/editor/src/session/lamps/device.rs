//! The light of lamps on the graphics device, as far as that knows it; the CPU does the rest.

use std::sync::Arc;

use clerestory_relight::RelightError;
use clerestory_relight::gpu::{Gpu, Lamplight, LitSample, TreeWords};
use clerestory_transport::lamps::{LampWords, PreparedLamps};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::visible::VisiblePoints;

use super::LampView;

/// A view on the device.
pub(super) struct LampDevice {
    scene: Arc<PreparedScene>,
    lamplight: Lamplight,
    size: [u32; 2],
    /// What the pixels see in each of their samples, as far as it was needed.
    samples: Vec<LitSample>,
}

/// Takes what rays meet in a scene to a device.
///
/// # Errors
/// A device that fails, or does not take so large a scene.
pub fn on_device(gpu: &Gpu, scene: &PreparedScene) -> Result<Lamplight, RelightError> {
    let (words, coats) = (scene.tree_words(), scene.coat_table());
    let tree = TreeWords {
        nodes: &words.nodes,
        blocks: &words.blocks,
        sheer: words.second,
        slabs: &words.slabs,
        coats: &coats,
    };
    Lamplight::new(gpu, tree)
}

impl LampDevice {
    /// Takes a scene to the device.
    ///
    /// # Errors
    /// A device that fails, or does not take so large a scene.
    pub fn new(gpu: &Gpu, view: &LampView) -> Result<LampDevice, RelightError> {
        let lamplight = on_device(gpu, &view.scene)?;
        let size = [view.film.width, view.film.height];
        Ok(LampDevice { scene: view.scene.clone(), lamplight, size, samples: Vec::new() })
    }

    /// A pass of a lamp at the points of a sample that is kept, each the first time in order; `None` where the CPU has to do it
    /// all, or when `stop` asked to.
    ///
    /// # Errors
    /// A device that fails, or is out of memory.
    pub fn direct(
        &mut self,
        (sample, points): (usize, &VisiblePoints),
        lamp: &PreparedLamps,
        pass: u32,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Vec<[f32; 3]>>, RelightError> {
        let scene = self.scene.clone();
        let completed = |found: &[[f32; 4]]| points.completed(&scene, lamp, pass, found, stop);
        Ok(self.found((sample, points), lamp, pass, completed)?.flatten())
    }

    /// Looks at what the device finds of it.
    fn found<T>(
        &mut self,
        (sample, points): (usize, &VisiblePoints),
        lamp: &PreparedLamps,
        pass: u32,
        look: impl FnOnce(&[[f32; 4]]) -> T,
    ) -> Result<Option<T>, RelightError> {
        let fits = |words: &LampWords| words.distribution.len() <= Lamplight::LONGEST_DISTRIBUTION;
        let Some(words) = lamp.words(&self.scene).filter(fits) else { return Ok(None) };
        if sample == self.samples.len() {
            let seen = points.words(&self.scene, 0);
            self.samples.push(self.lamplight.sample(self.size, &seen.starts, &seen.points)?);
        }
        let Some(kept) = self.samples.get(sample) else { return Ok(None) };
        let lamp = (&words.lamp, words.distribution.as_slice());
        self.lamplight.light(kept, lamp, &points.shifts(pass), look).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use clerestory_relight::DeviceChoice;
    use clerestory_transport::camera::Film;
    use clerestory_transport::import;
    use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
    use clerestory_transport::light::LightSetting;
    use clerestory_transport::patches::NARROW_ALPHA;
    use clerestory_transport::scene::{AlphaMode, Encoding, Filter, Image, Material, Scene, Texture, TextureRef, Wrap};
    use clerestory_transport::visible::VisibleConfig;
    use glam::{Affine2, Quat, Vec2, Vec3, Vec4};

    use super::*;
    use crate::support::{ROOM, room, scaled_room};

    const FILM: Film = Film { width: 72, height: 50 };

    /// Whether it is a failure that there is no device.
    fn is_required() -> bool {
        std::env::var_os("CLERESTORY_REQUIRE_GPU").is_some()
    }

    fn view(name: &str, bytes: &[u8]) -> LampView {
        view_of(import::load_bytes(name, bytes).unwrap().scene)
    }

    fn view_of(scene: Scene) -> LampView {
        let scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
        let camera = scene.scene.cameras[0].clone();
        LampView { scene, camera, film: FILM, patches: None, measures: false, bounces: None, device: None }
    }

    /// The test room with a card of which half is there, a clear pane, and a table with bumps.
    fn furnished() -> Scene {
        let mut scene = room();
        scene.mesh.uvs[0] = vec![Vec2::ZERO; scene.mesh.positions.len()];
        let texture = |texels: [[u8; 4]; 4]| {
            let image = Arc::new(Image { width: 2, height: 2, texels: texels.to_vec() });
            Texture { image, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest }
        };
        let (there, gone) = ([200, 150, 90, 255], [200, 150, 90, 0]);
        scene.textures = vec![
            texture([there, gone, gone, there]),
            texture([[128, 128, 255, 255], [190, 128, 230, 255], [128, 190, 230, 255], [90, 90, 235, 255]]),
        ];
        let used = |texture, encoding| Some(TextureRef { texture, uv_set: 0, transform: Affine2::IDENTITY, encoding });
        let plain = || Material { metallic: 0.0, double_sided: true, ..Material::default() };
        let alpha = AlphaMode::Mask { cutoff: 0.5 };
        let card = Material { base_color_texture: used(0, Encoding::Srgb), alpha, ..plain() };
        let pane = Material { roughness: 0.0, transmission: 1.0, ..plain() };
        let bumps = Material { roughness: 0.4, normal_texture: used(1, Encoding::Linear), ..plain() };
        let sides = [Vec3::X, Vec3::Y];
        add(&mut scene, Vec3::new(-0.6, -0.5, -0.3), sides.map(|side| side * 0.7), card);
        add(&mut scene, Vec3::new(0.0, -0.6, 0.2), sides, pane);
        add(&mut scene, Vec3::new(-0.9, -0.6, 0.5), [Vec3::X * 1.8, Vec3::NEG_Z * 1.4], bumps);
        scene.mesh.tangents = vec![Vec3::X.extend(1.0); scene.mesh.positions.len()];
        scene
    }

    /// A parallelogram from a corner along two edges, with a texture over all of it.
    fn add(scene: &mut Scene, corner: Vec3, [u, v]: [Vec3; 2], material: Material) {
        let first = scene.mesh.positions.len() as u32;
        let mesh = &mut scene.mesh;
        for [x, y] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            mesh.positions.push(corner + u * x + v * y);
            mesh.normals.push(u.cross(v).normalize());
            mesh.uvs[0].push(Vec2::new(x, y));
        }
        mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|triangle| triangle.map(|vertex| first + vertex)));
        mesh.triangle_material.extend([scene.materials.len() as u32; 2]);
        mesh.triangle_node.extend([0; 2]);
        scene.materials.push(material);
    }

    fn lamps(position: Vec3, aim: Vec3) -> Vec<PreparedLamps> {
        let (inner_rad, outer_rad) = (0.3, 0.6);
        let shapes = [
            (LampShape::Point, LampUnit::Lumen),
            (LampShape::Spot { inner_rad, outer_rad }, LampUnit::Lumen),
            (LampShape::Directional { radius_rad: 0.0 }, LampUnit::Lux),
            (LampShape::Rectangle { size_m: [0.3, 0.2] }, LampUnit::Lumen),
            (LampShape::Disk { radius_m: 0.15 }, LampUnit::Lumen),
            (LampShape::Sphere { radius_m: 0.05 }, LampUnit::Lumen),
        ];
        let plain = shapes.map(|(shape, unit)| lamp(shape, unit, [position, aim]));
        plain.into_iter().chain(measured([position, aim])).collect()
    }

    fn lamp(shape: LampShape, unit: LampUnit, place: [Vec3; 2]) -> PreparedLamps {
        PreparedLamps::new(&[free(shape, unit, place)], None).unwrap().0
    }

    fn free(shape: LampShape, unit: LampUnit, [position, aim]: [Vec3; 2]) -> FreeLamp {
        let setting = LightSetting::default();
        FreeLamp {
            key: "lamp".into(),
            shape,
            position,
            aim,
            strength: 500.0,
            unit,
            setting,
            turn_rad: 0.0,
            replaces: None,
        }
    }

    /// Lamps with measured distributions that are unlike on all sides, turned: one whose planes meet in its aim, one whose planes meet
    /// across it.
    fn measured(place: [Vec3; 2]) -> [PreparedLamps; 2] {
        let in_aim = lopsided(
            1,
            &[0.0, 5.0, 12.0, 20.0, 33.0, 47.0, 60.0, 75.0, 90.0, 110.0, 130.0, 150.0],
            &[0.0, 30.0, 45.0, 100.0, 160.0, 200.0, 260.0, 300.0, 360.0],
        );
        let across = lopsided(
            2,
            &[-120.0, -80.0, -45.0, -20.0, -5.0, 10.0, 30.0, 60.0, 100.0],
            &[-90.0, -60.0, -25.0, 0.0, 15.0, 40.0, 70.0, 90.0],
        );
        [in_aim, across].map(|file| measured_by(&file, place))
    }

    /// A turned lamp that shines as a file says.
    fn measured_by(file: &str, place: [Vec3; 2]) -> PreparedLamps {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("lamp.ies"), file).unwrap();
        let shape = LampShape::Profile { file: "lamp.ies".into() };
        let lamp = FreeLamp { turn_rad: 0.7, ..free(shape, LampUnit::Lumen, place) };
        PreparedLamps::new(&[lamp], Some(folder.path())).unwrap().0
    }

    /// An LM-63 file of a type, 1 for C and 2 for B, by vertical and horizontal angles in degrees; where planes meet they agree.
    fn lopsided(photometry: u32, vertical: &[f64], horizontal: &[f64]) -> String {
        let candela = |v: f64, h: f64| {
            let (sine, around) = if photometry == 1 { (v.sin(), h) } else { (h.cos(), v) };
            600.0 + sine * (250.0 * (around - 0.4).cos() + 150.0 * (2.0 * around).sin())
        };
        let mut numbers = [vertical, horizontal].concat();
        for h in horizontal {
            numbers.extend(vertical.iter().map(|v| candela(v.to_radians(), h.to_radians())));
        }
        let counts = format!("{} {}", vertical.len(), horizontal.len());
        let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
        format!("IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 {counts} {photometry} 2 0 0 0\n1 1 10\n{}\n", numbers.join("\n"))
    }

    /// Pixels that differ by more than rounding does, and the sums of both.
    fn compare(found: &[[f32; 3]], expected: &[[f32; 3]]) -> (usize, [f32; 2]) {
        let peak = expected.as_flattened().iter().fold(0.0f32, |most, x| most.max(*x));
        let differs = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|c| (a[c] - b[c]).abs() > 2e-3 * b[c] + 1e-4 * peak);
        let n_different = found.iter().zip(expected).filter(|(a, b)| differs((*a, *b))).count();
        (n_different, [found, expected].map(|light| light.as_flattened().iter().sum()))
    }

    /// Holds what a device finds of a lamp against what the CPU finds.
    fn assert_as_cpu(device: &mut LampDevice, points: &VisiblePoints, lamp: &PreparedLamps, pass: u32, what: &str) {
        let found = device.direct((0, points), lamp, pass, &|| false).unwrap().unwrap();
        let expected = points.direct(&device.scene, lamp, pass, &|| false).unwrap();
        let (n_different, [sum, expected_sum]) = compare(&found, &expected);
        assert!(n_different <= FILM.n_pixels() / 200, "{what}, pass {pass}: {n_different} pixels");
        assert!((sum - expected_sum).abs() <= 1e-3 * expected_sum, "{what}: {sum}, {expected_sum}");
    }

    /// Pixels that a device leaves to the CPU, and those that it lights.
    fn left_and_lit(device: &mut LampDevice, points: &VisiblePoints, lamp: &PreparedLamps) -> [usize; 2] {
        let raw = device.found((0, points), lamp, 0, <[_]>::to_vec).unwrap().unwrap();
        let n_left = raw.iter().filter(|rgb| rgb[3] != 0.0).count();
        [n_left, raw.iter().filter(|rgb| rgb[..3] != [0.0; 3]).count()]
    }

    #[test]
    fn every_device_finds_the_light_that_the_cpu_finds() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let assets = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/scenes");
        let scenes =
            ["gallery", "caustics", "diffuse"].map(|name| std::fs::read(format!("{assets}/{name}.glb")).unwrap());
        for (gpu, bytes) in gpus.iter().flat_map(|gpu| scenes.iter().map(move |bytes| (gpu, bytes))) {
            let view = view("scene.glb", bytes);
            let config = VisibleConfig { samples: 1, narrow_alpha: NARROW_ALPHA, ..VisibleConfig::default() };
            let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
            let mut device = LampDevice::new(gpu, &view).unwrap();
            let ahead = view.camera.direction(FILM, Vec2::new(36.0, 25.0));
            let at = view.camera.position() + ahead * 1.5;
            for (nth, lamp) in lamps(at, at + ahead - Vec3::Y).iter().enumerate() {
                for pass in [0, 3] {
                    assert_as_cpu(&mut device, &points, lamp, pass, &format!("lamp {nth}"));
                }
                let [n_left, n_lit] = left_and_lit(&mut device, &points, lamp);
                assert!(n_left < FILM.n_pixels() / 2, "lamp {nth}: {n_left} pixels are left to the CPU");
                // Parallel light does not get into rooms.
                assert!(n_lit > FILM.n_pixels() / 20 || nth == 2, "lamp {nth}: {n_lit} pixels are lit by the device");
            }
        }
    }

    #[test]
    fn every_device_sees_cards_panes_and_bumps_as_the_cpu_does() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        for gpu in &gpus {
            let view = view_of(furnished());
            let config = VisibleConfig { samples: 1, narrow_alpha: NARROW_ALPHA, ..VisibleConfig::default() };
            let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
            let mut device = LampDevice::new(gpu, &view).unwrap();
            let place = [Vec3::new(0.1, 0.5, 0.3), Vec3::new(-0.3, -1.0, -0.5)];
            let narrow = lamp(
                LampShape::Spot { inner_rad: 0.0, outer_rad: 0.03 },
                LampUnit::Lumen,
                [place[0], Vec3::new(-0.3, 0.6, -1.0)],
            );
            for (nth, lamp) in lamps(place[0], place[1]).iter().chain([&narrow]).enumerate() {
                assert_as_cpu(&mut device, &points, lamp, 0, &format!("lamp {nth}"));
                // Parallel light does not get into rooms.
                let [_, n_lit] = left_and_lit(&mut device, &points, lamp);
                assert!(n_lit > 0 || nth == 2, "lamp {nth}: {n_lit} pixels are lit by the device");
            }
        }
    }

    #[test]
    fn a_distribution_of_too_many_angles_is_left_to_the_cpu() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let Some(gpu) = gpus.into_iter().next() else { return println!("skipped: no adapter") };
        let view = view_of(room());
        let config = VisibleConfig { samples: 1, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
        let mut device = LampDevice::new(&gpu, &view).unwrap();
        let mut is_taken = |n_planes: u16| {
            let [vertical, horizontal] = [(180.0, 512), (360.0, n_planes)]
                .map(|(end, n)| (0..=n).map(|nth| end * f64::from(nth) / f64::from(n)).collect::<Vec<f64>>());
            let place = [Vec3::new(0.1, 0.1, -0.7), Vec3::new(0.3, -0.2, -1.0)];
            let lamp = measured_by(&lopsided(1, &vertical, &horizontal), place);
            device.direct((0, &points), &lamp, 0, &|| false).unwrap().is_some()
        };
        // With the angles 509 planes of 513 intensities are five numbers less than 2¹⁸.
        assert!(is_taken(508) && !is_taken(509));
    }

    #[test]
    fn what_lies_close_to_a_flat_lamp_is_found_by_every_device() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let view = view_of(room());
        let config = VisibleConfig { samples: 1, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
        let lamps = lamps(Vec3::new(0.1, 0.1, -0.7), Vec3::new(0.3, -0.2, -1.0));
        for (gpu, lamp) in gpus.iter().flat_map(|gpu| lamps[3..5].iter().map(move |lamp| (gpu, lamp))) {
            let mut device = LampDevice::new(gpu, &view).unwrap();
            let [n_left, _] = left_and_lit(&mut device, &points, lamp);
            assert!(n_left < FILM.n_pixels() / 50, "{lamp:?}: {n_left} pixels are left to the CPU");
            assert_as_cpu(&mut device, &points, lamp, 0, &format!("{lamp:?}"));
        }
    }

    #[test]
    fn a_model_of_centimeters_is_lit_by_every_device_as_by_the_cpu() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let mut scene = scaled_room(0.01);
        let camera = &mut scene.cameras[0];
        camera.world_from_camera.w_axis = (0.01 * camera.position()).extend(1.0);
        let view = view_of(scene);
        let config = VisibleConfig { samples: 1, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
        let place = 0.01 * Vec3::new(0.1, 0.5, -0.3);
        let lamp = lamp(LampShape::Point, LampUnit::Candela, [place, place - Vec3::Y]);
        for gpu in &gpus {
            let mut device = LampDevice::new(gpu, &view).unwrap();
            assert_as_cpu(&mut device, &points, &lamp, 0, "a point lamp");
        }
    }

    /// A closed box of a material of its own, turned about the origin.
    fn add_box(scene: &mut Scene, (center, half): (Vec3, Vec3), turn: Quat, material: Material) {
        let (mesh, material_idx) = (&mut scene.mesh, scene.materials.len() as u32);
        scene.materials.push(material);
        for (axis, side) in (0..3).flat_map(|axis| [-1.0f32, 1.0].map(|side| (axis, side))) {
            let along = |axis: usize| Vec3::AXES[axis % 3] * half[axis % 3];
            let (n, u, v) = (along(axis) * side, along(axis + 1), along(axis + 2) * side);
            let first = mesh.positions.len() as u32;
            mesh.positions.extend([-u - v, u - v, u + v, v - u].map(|corner| turn * (center + n + corner)));
            mesh.normals.extend([turn * n.normalize(); 4]);
            mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|nth| first + nth)));
            mesh.triangle_material.extend([material_idx; 2]);
            mesh.triangle_node.extend([0; 2]);
        }
    }

    #[test]
    fn lamps_in_bad_places_are_lit_by_every_device_as_by_the_cpu() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let mut scene = room();
        let within = Vec3::new(0.4, -0.3, -0.6);
        let plain = Material { metallic: 0.0, double_sided: true, ..Material::default() };
        add_box(&mut scene, (within, Vec3::new(0.25, 0.3, 0.25)), Quat::IDENTITY, plain);
        let view = view_of(scene);
        let config = VisibleConfig { samples: 1, narrow_alpha: NARROW_ALPHA, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
        // Next to a wall, at the eye, outside and far away, within a solid.
        let [wall, outside, far] = [Vec3::new(-1.0, 0.1, -0.4), Vec3::new(1.5, 0.0, -0.2), Vec3::splat(100.0)];
        let places = [wall + Vec3::X * 0.03, view.camera.position(), outside, far, within];
        for gpu in &gpus {
            let mut device = LampDevice::new(gpu, &view).unwrap();
            // Rays of a device start up to some hundredths of a millimeter above a surface: by as much a lamp is nearer to it.
            for (above, off) in [(0.0, f32::INFINITY), (1e-6, f32::INFINITY), (1e-4, 0.3), (1e-3, 0.03)] {
                let place = wall + Vec3::X * above;
                for (nth, lamp) in lamps(place, place - Vec3::Y).iter().enumerate() {
                    let found = device.direct((0, &points), lamp, 0, &|| false).unwrap().unwrap();
                    assert!(found.as_flattened().iter().all(|x| x.is_finite() && *x >= 0.0), "lamp {nth}, {above} m");
                    let expected = points.direct(&device.scene, lamp, 0, &|| false).unwrap();
                    let (_, [sum, expected_sum]) = compare(&found, &expected);
                    let is_near = off.is_infinite() || (sum - expected_sum).abs() <= off * expected_sum;
                    assert!(is_near, "lamp {nth}, {above} m: {sum}, {expected_sum}");
                }
            }
            for place in places {
                let aim = place - Vec3::Y;
                let none = [
                    LampShape::Rectangle { size_m: [0.0; 2] },
                    LampShape::Disk { radius_m: 0.0 },
                    LampShape::Sphere { radius_m: 0.0 },
                ];
                let none = none.map(|shape| lamp(shape, LampUnit::Lumen, [place, aim]));
                for (nth, lamp) in lamps(place, aim).iter().chain(&none).enumerate() {
                    let what = format!("lamp {nth} at {place}");
                    assert_as_cpu(&mut device, &points, lamp, 0, &what);
                    let found = device.direct((0, &points), lamp, 0, &|| false).unwrap().unwrap();
                    let is_dark = found.iter().all(|rgb| *rgb == [0.0; 3]);
                    assert!(is_dark || ![outside, far, within].contains(&place), "{what} shines through a wall");
                }
            }
        }
    }

    /// A room without its wall behind the viewer, who sees it through a pane of solid glass from wall to wall with a bar in it, and a
    /// smaller one where nothing lies in the glass.
    fn glazed() -> LampView {
        let wide = (Vec3::Z * -0.1, Vec3::new(1.2, 1.2, 0.03));
        let small = (Vec3::new(-0.3, 0.1, 0.1), Vec3::new(0.6, 0.7, 0.04));
        let mut scene = glazed_with(&[wide, small], Quat::IDENTITY);
        let bar = (Vec3::new(0.15, -0.1, -0.1), Vec3::new(0.01, 0.3, 0.01));
        add_box(&mut scene, bar, Quat::IDENTITY, Material { metallic: 0.0, ..Material::default() });
        view_of(scene)
    }

    /// The same behind two panes beside each other.
    fn glazed_aslant(turn: Quat) -> LampView {
        view_of(glazed_with(&[-0.7, 0.7].map(|x| (Vec3::X * x, Vec3::new(0.7, 1.2, 0.03))), turn))
    }

    /// The same behind nine panes, three by three, and a tenth before them: too many for one leaf of their tree.
    fn glazed_in_a_grid() -> LampView {
        let steps = [-0.8, 0.0, 0.8];
        let grid = steps.map(|x| steps.map(|y| (Vec3::new(x, y, -0.1), Vec3::new(0.4, 0.4, 0.01))));
        let before = (Vec3::new(-0.3, 0.1, 0.1), Vec3::new(0.6, 0.7, 0.02));
        let panes: Vec<(Vec3, Vec3)> = grid.into_iter().flatten().chain([before]).collect();
        view_of(glazed_with(&panes, Quat::IDENTITY))
    }

    /// Such a room with panes as given by middle and half of their size, and then turned about the origin; every second is tinted.
    fn glazed_with(panes: &[(Vec3, Vec3)], turn: Quat) -> Scene {
        let room = ROOM.replace(r#""count": 36"#, r#""count": 30"#);
        let mut scene = import::load_bytes("room.gltf", room.as_bytes()).unwrap().scene;
        let glass = Material {
            base_color: Vec4::new(0.9, 0.8, 0.95, 1.0),
            metallic: 0.0,
            roughness: 0.0,
            transmission: 1.0,
            thickness: 1.0,
            ..Material::default()
        };
        let tinted =
            Material { attenuation_distance: 0.1, attenuation_color: Vec3::new(0.9, 0.6, 0.7), ..glass.clone() };
        for (nth, &pane) in panes.iter().enumerate() {
            let material = if nth % 2 == 0 { &glass } else { &tinted };
            add_box(&mut scene, pane, turn, material.clone());
        }
        scene
    }

    #[test]
    fn every_device_finds_the_light_that_solid_panes_bend() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let turn = Quat::from_rotation_y(0.5);
        let views = [(glazed(), Quat::IDENTITY), (glazed_aslant(turn), turn), (glazed_in_a_grid(), Quat::IDENTITY)];
        for (view, turn) in views {
            let [behind, before] = [Vec3::new(0.1, 0.2, -0.6), Vec3::new(-0.2, 0.1, 0.6)].map(|place| turn * place);
            assert_light_through_panes(&gpus, &view, [behind, before]);
        }
    }

    /// Holds devices against the CPU for lamps on both sides of panes.
    fn assert_light_through_panes(gpus: &[Gpu], view: &LampView, [behind, before]: [Vec3; 2]) {
        let config = VisibleConfig { samples: 1, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
        let sides = [[behind, before], [before, behind]].map(|[place, aim]| {
            let soft = lamp(LampShape::Directional { radius_rad: 0.1 }, LampUnit::Lux, [place, aim]);
            lamps(place, aim).into_iter().chain([soft]).collect::<Vec<_>>()
        });
        for (gpu, (side, lamps)) in gpus.iter().flat_map(|gpu| sides.iter().enumerate().map(move |side| (gpu, side))) {
            let mut device = LampDevice::new(gpu, view).unwrap();
            for (nth, lamp) in lamps.iter().enumerate() {
                let what = format!("lamp {nth} of side {side}");
                assert_as_cpu(&mut device, &points, lamp, 0, &what);
                let [n_left, n_lit] = left_and_lit(&mut device, &points, lamp);
                assert!(n_left < FILM.n_pixels() / 4, "{what}: {n_left} pixels are left to the CPU");
                // Only what lies behind the panes is seen, so that the light of the other side comes through them.
                assert!(n_lit > FILM.n_pixels() / 5 || side == 0, "{what}: {n_lit} pixels are lit by the device");
            }
        }
    }

    #[test]
    fn every_device_counts_faces_of_solid_panes_as_bounces() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let (view, [behind, before]) = (glazed(), [Vec3::new(0.1, 0.2, -0.6), Vec3::new(-0.2, 0.1, 0.6)]);
        for (gpu, bounces) in gpus.iter().flat_map(|gpu| [2, 3, 4, 6].map(|bounces| (gpu, bounces))) {
            let config = VisibleConfig { samples: 1, bounces: Some(bounces), ..VisibleConfig::default() };
            let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
            let mut device = LampDevice::new(gpu, &view).unwrap();
            for (nth, lamp) in lamps(before, behind).iter().enumerate() {
                let found = device.direct((0, &points), lamp, 0, &|| false).unwrap().unwrap();
                let expected = points.direct(&view.scene, lamp, 0, &|| false).unwrap();
                let (n_different, [sum, expected_sum]) = compare(&found, &expected);
                assert!(n_different <= FILM.n_pixels() / 200, "lamp {nth}, {bounces} bounces: {n_different} pixels");
                // So little light is left that an edge of a shadow in one pixel is a thousandth of it.
                let off = (sum - expected_sum).abs();
                assert!(off <= 5e-3 * expected_sum, "lamp {nth}, {bounces} bounces: {sum}, {expected_sum}");
            }
        }
    }

    #[test]
    fn a_pane_whose_looks_differ_from_place_to_place_is_left() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let Some(gpu) = gpus.into_iter().next() else { return println!("skipped: no adapter") };
        let mut scene = glazed().scene.scene.clone();
        scene.mesh.colors = vec![Vec4::new(0.5, 0.6, 0.7, 1.0); scene.mesh.positions.len()];
        let view = view_of(scene);
        let config = VisibleConfig { samples: 1, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
        let lamp = &lamps(Vec3::new(-0.2, 0.1, 0.6), Vec3::ZERO)[0];
        let mut device = LampDevice::new(&gpu, &view).unwrap();
        let [n_left, _] = left_and_lit(&mut device, &points, lamp);
        assert!(n_left > FILM.n_pixels() / 10, "{n_left}");
        let found = device.direct((0, &points), lamp, 0, &|| false).unwrap().unwrap();
        let (n_different, _) = compare(&found, &points.direct(&view.scene, lamp, 0, &|| false).unwrap());
        assert!(n_different <= FILM.n_pixels() / 200, "{n_different} pixels");
    }

    #[test]
    fn parallel_light_is_found_and_what_a_device_does_not_know_is_left() {
        let gpus = Gpu::all_headless(DeviceChoice::Any);
        assert!(!gpus.is_empty() || !is_required(), "no adapter");
        let Some(gpu) = gpus.into_iter().next() else { return println!("skipped: no adapter") };
        // The first wall of the room, the left one, alone.
        let wall = ROOM.replace(r#""count": 36"#, r#""count": 6"#);
        let view = view("wall.gltf", wall.as_bytes());
        let config = VisibleConfig { samples: 1, ..VisibleConfig::default() };
        let points = VisiblePoints::new(&view.scene, &view.camera, FILM, config, &|| false).unwrap();
        let mut device = LampDevice::new(&gpu, &view).unwrap();
        let eye = view.camera.position();
        let [lamp, soft] = [0.0, 0.1].map(|radius_rad| {
            let aim = eye + Vec3::new(-1.0, -0.1, -0.2);
            lamp(LampShape::Directional { radius_rad }, LampUnit::Lux, [eye, aim])
        });
        let lamp = &lamp;
        for lamp in [lamp, &soft] {
            let found = device.direct((0, &points), lamp, 0, &|| false).unwrap().unwrap();
            let (n_different, [sum, _]) = compare(&found, &points.direct(&view.scene, lamp, 0, &|| false).unwrap());
            assert!(n_different <= FILM.n_pixels() / 200 && sum > 0.0, "{n_different} pixels differ, {sum}");
        }
        assert!(device.direct((5, &points), lamp, 0, &|| false).unwrap().is_none(), "that sample is not kept");
        let two = [lamp, lamp].map(|_| FreeLamp {
            key: "two".into(),
            shape: LampShape::Point,
            position: eye,
            aim: eye - Vec3::Y,
            strength: 1.0,
            unit: LampUnit::Lumen,
            setting: LightSetting::default(),
            turn_rad: 0.0,
            replaces: None,
        });
        let two =
            PreparedLamps::new(&[two[0].clone(), FreeLamp { key: "other".into(), ..two[1].clone() }], None).unwrap().0;
        assert!(device.direct((0, &points), &two, 0, &|| false).unwrap().is_none(), "lamps are lit one by one");
    }
}
