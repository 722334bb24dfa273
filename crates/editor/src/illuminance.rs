//! Illuminance of a surface in the figures of lighting standards: average, minimum, maximum and uniformity, in lux and foot-candles.

use std::io::Write;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use clerestory_nystrom::BlockLowRank;
use clerestory_relight::display::luminance;
use clerestory_relight::{CpuRelighter, Frame, Radiance, Relight};
use clerestory_transport::bake::Bake;
use clerestory_transport::lamps::PreparedLamps;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sensors::SensorGrid;
use glam::Vec3;
use rayon::prelude::*;

use crate::legend::number_words;
use crate::marks::{Marks, Seen, weighed};
use crate::table::text_cell;

/// Lux of a foot-candle, a lumen per square foot.
pub const FOOT_CANDLE_LX: f64 = 10.763_910_416_709_722;

/// What free lamps add to the light that arrives; nothing by default.
#[derive(Clone, Default)]
pub struct AddedLux {
    /// Coefficients of the columns of patches: what surfaces make of their light. Empty without patches.
    pub of_patches: Vec<[f32; 3]>,
    /// What comes straight to the surfaces that pixels see, lux per channel, where it is known.
    pub straight: Option<Arc<Radiance>>,
    /// The lamps in their scene, for points that no pixel sees.
    pub lamps: Option<(Arc<PreparedScene>, PreparedLamps)>,
}

impl AddedLux {
    /// Of lamps for points that no pixel sees.
    pub fn of_lamps(bake: &Bake, scene: Arc<PreparedScene>, lamps: PreparedLamps) -> AddedLux {
        let (patches, bounces) = (bake.header.patches.as_ref(), bake.header.config.bounces);
        let of_patches = patches.map_or_else(Vec::new, |patches| lamps.light_on_patches(&scene, patches, bounces));
        AddedLux { of_patches, straight: None, lamps: Some((scene, lamps)) }
    }
}

/// Illuminance of some points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LuxFigures {
    /// Points that count.
    pub points: usize,
    /// Mean in lux.
    pub average: f64,
    /// Least in lux.
    pub minimum: f64,
    /// Largest in lux.
    pub maximum: f64,
    /// Area of surface in m², where it is known.
    pub area_m2: Option<f64>,
}

impl LuxFigures {
    /// Of values in lux, each with its weight; the weights need not sum to anything, and what weighs nothing does not count. Dark without
    /// values.
    pub fn of(values: impl IntoIterator<Item = (f64, f64)>) -> LuxFigures {
        let (mut points, mut sum, mut weights) = (0, 0.0, 0.0);
        let (mut minimum, mut maximum) = (f64::INFINITY, 0.0f64);
        for (lux, weight) in values.into_iter().filter(|(_, weight)| *weight > 0.0) {
            // Ranks that are left out may take a dark point a little below nothing.
            let lux = lux.max(0.0);
            points += 1;
            sum += weight * lux;
            weights += weight;
            (minimum, maximum) = (minimum.min(lux), maximum.max(lux));
        }
        let average = if weights > 0.0 { sum / weights } else { 0.0 };
        let minimum = if points > 0 { minimum } else { 0.0 };
        LuxFigures { points, average, minimum, maximum, area_m2: None }
    }

    /// U0, minimum over average; `None` in the dark.
    pub fn uniformity(&self) -> Option<f64> {
        (self.average > 0.0).then(|| self.minimum / self.average)
    }

    /// Ud, minimum over maximum; `None` in the dark.
    pub fn diversity(&self) -> Option<f64> {
        (self.maximum > 0.0).then(|| self.minimum / self.maximum)
    }
}

/// Illuminance with three digits or more, without a unit.
pub fn lux_words(lux: f64) -> String {
    match lux {
        lux if lux >= 100.0 => format!("{lux:.0}"),
        lux if lux >= 1.0 => format!("{lux:.1}"),
        lux => number_words(lux as f32),
    }
}

/// A share with two digits.
pub fn share_words(share: Option<f64>) -> String {
    share.map_or("undefined".into(), |share| format!("{share:.2}"))
}

/// Irradiance of a matrix of a bake, lux per channel, as a picture: without what free lamps send straight.
///
/// # Errors
/// If factors and coefficients do not belong together.
pub fn irradiance_of(bake: &Bake, set: usize, rig: &LightRig, of_patches: &[[f32; 3]]) -> Result<Radiance> {
    let film = bake.header.irradiance_film(set);
    relit(bake, set, bake.irradiance[set].clone(), [film.width, film.height], (rig, of_patches))
}

fn relit(
    bake: &Bake,
    set: usize,
    groups: Vec<BlockLowRank>,
    [width, height]: [u32; 2],
    (rig, of_patches): (&LightRig, &[[f32; 3]]),
) -> Result<Radiance> {
    let frame = Frame { width, height, groups };
    let mut coefficients = bake.header.irradiance_coefficients(set, rig);
    bake.header.add_of_patches(&mut coefficients, of_patches);
    let mut irradiance = Radiance::default();
    let relit = CpuRelighter::new(&frame)?.relight(&coefficients, &mut irradiance);
    relit.context("cannot relight the irradiance")?;
    Ok(irradiance)
}

/// Irradiance at the pixels under a rig and its free lamps, lux per channel.
///
/// # Errors
/// If the bake holds none.
pub fn seen_irradiance(bake: &Bake, rig: &LightRig, added: &AddedLux) -> Result<Radiance> {
    let set = bake.pixel_irradiance();
    if set.is_none() && bake.header.basis.is_measured() {
        bail!("the bake is of pictures, which tell no irradiance; that takes a scene");
    }
    let set = set.context("the bake holds no irradiance of its pixels; bake it again with --irradiance")?;
    let mut irradiance = irradiance_of(bake, set, rig, &added.of_patches)?;
    added.straight.iter().for_each(|straight| irradiance.add(straight));
    Ok(irradiance)
}

/// Measured points of a grid, meters, and their illuminance in lux.
///
/// # Errors
/// If the light is too strong for finite numbers.
pub fn of_grid(
    bake: &Bake,
    (set, grid): (usize, &SensorGrid),
    (rig, added): (&LightRig, &AddedLux),
) -> Result<Vec<(Vec3, f32)>> {
    let irradiance = irradiance_of(bake, set, rig, &added.of_patches)?;
    let bounces = bake.header.config.bounces;
    let straight = |point: Vec3| {
        added.lamps.as_ref().map_or(Vec3::ZERO, |(scene, lamps)| lamps.irradiance(scene, point, grid.normal, bounces))
    };
    let lux = |point: Vec3, rgb: &[f32; 3]| luminance((Vec3::from(*rgb) + straight(point)).to_array()).max(0.0);
    let measured = |(number, rgb): (usize, &[f32; 3])| {
        let point = grid.point(u32::try_from(number).ok()?)?;
        Some((point, lux(point, rgb)))
    };
    let points: Vec<(Vec3, f32)> = irradiance.pixels.par_iter().enumerate().filter_map(measured).collect();
    if points.iter().any(|(_, lux)| !lux.is_finite()) {
        bail!("some sensors of `{}` read no finite number; check the intensities of the look", grid.name);
    }
    Ok(points)
}

/// Writes points of grids as comma-separated values, quoted as RFC 4180 asks: the name of the grid, meters and lux.
///
/// # Errors
/// If they cannot be written.
pub fn write_points<'a>(
    writer: &mut impl Write,
    grids: impl IntoIterator<Item = (&'a str, &'a [(Vec3, f32)])>,
) -> Result<()> {
    writeln!(writer, "grid,x,y,z,lux")?;
    for (name, points) in grids {
        let name = text_cell(name);
        for (point, lux) in points {
            writeln!(writer, "{name},{},{},{},{lux}", point.x, point.y, point.z)?;
        }
    }
    Ok(())
}

/// Illuminance of the marked pixels, by area where it is known what they see.
///
/// # Errors
/// If the bake holds no irradiance of its pixels.
pub fn of_marks(
    bake: &Bake,
    (rig, added): (&LightRig, &AddedLux),
    marks: &Marks,
    seen: Option<&Seen>,
) -> Result<LuxFigures> {
    let Some(set) = bake.pixel_irradiance() else {
        bail!(
            "the bake holds no irradiance of its pixels; bake it again with --irradiance, in the window with Illuminance"
        );
    };
    // Blocks without a mark are left out of the work.
    let mut groups = bake.irradiance[set].clone();
    let mut bundles = Vec::new();
    for block in 0..groups.first().map_or(0, |group| group.blocks.len()) {
        groups[0].partition.bundles(block, &mut bundles);
        if !bundles.iter().any(|pixel| marks.holds(*pixel)) {
            groups.iter_mut().for_each(|group| group.blocks[block] = None);
        }
    }
    let size = [marks.film.width, marks.film.height];
    let mut picture = relit(bake, set, groups, size, (rig, &added.of_patches))?;
    added.straight.iter().for_each(|straight| picture.add(straight));
    let values = weighed(marks.pixels(), seen).into_iter();
    let values =
        values.map(|(pixel, weight)| (f64::from(luminance(picture.pixels[pixel as usize])), f64::from(weight)));
    let area = seen.map(|seen| marks.pixels().iter().map(|pixel| f64::from(seen.area_m2(*pixel))).sum());
    Ok(LuxFigures { area_m2: area, ..LuxFigures::of(values) })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
    use clerestory_transport::camera::{Camera, Film};
    use clerestory_transport::emitters::SkyRequest;
    use clerestory_transport::irradiance::IrradianceRows;
    use clerestory_transport::prepared::PreparedScene;
    use clerestory_transport::scene::{Material, Mesh, PunctualKind, PunctualLight, Scene, SceneNode};
    use clerestory_transport::sensors::{IrradianceRequest, WorkPlane};
    use clerestory_transport::sky::SkyForm;

    use super::*;
    use crate::marks::Kin;

    #[test]
    fn figures_are_those_of_the_standards() {
        let told = LuxFigures::of([(100.0, 1.0), (500.0, 2.0), (300.0, 1.0)]);
        assert_eq!((told.points, told.average, told.minimum, told.maximum), (3, 350.0, 100.0, 500.0));
        assert!((told.uniformity().unwrap() - 100.0 / 350.0).abs() < 1e-12 && told.diversity() == Some(0.2));
        let dark = LuxFigures::of([(-1e-3, 1.0)]);
        assert_eq!((dark.average, dark.uniformity(), dark.diversity()), (0.0, None, None));
        assert_eq!(LuxFigures::of([]).minimum, 0.0);
        let beside_nothing = LuxFigures::of([(0.0, 0.0), (100.0, 1.0), (300.0, 1.0)]);
        assert_eq!((beside_nothing.points, beside_nothing.minimum), (2, 100.0), "no surface, no point");
        assert_eq!([0.0, 2e-4, 0.25, 12.0, 480.4].map(lux_words), ["0", "2e-4", "0.25", "12.0", "480"]);
    }

    fn plain() -> (&'static LightRig, &'static AddedLux) {
        use std::sync::LazyLock;
        static NOTHING: LazyLock<(LightRig, AddedLux)> = LazyLock::new(Default::default);
        (&NOTHING.0, &NOTHING.1)
    }

    const FILM: Film = Film { width: 120, height: 90 };
    /// A pixel that sees the middle of the floor.
    const MIDDLE: u32 = 120 * 45 + 60;
    const CANDELA: f32 = 50.0;
    const HEIGHT: f32 = 2.0;

    /// A floor of 4 m × 4 m with nothing on it, seen from a corner of the sky, and a lamp above its middle.
    fn floor(sky: Option<&SkyRequest>) -> (Bake, Seen) {
        baked(sky, |_| vec![IrradianceRows::Pixels])
    }

    fn baked(sky: Option<&SkyRequest>, rows: impl FnOnce(&PreparedScene) -> Vec<IrradianceRows>) -> (Bake, Seen) {
        let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let mesh = Mesh {
            positions: vec![corner(-2.0, 2.0), corner(2.0, 2.0), corner(2.0, -2.0), corner(-2.0, -2.0)],
            normals: vec![Vec3::Y; 4],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            triangle_material: vec![0; 2],
            triangle_node: vec![0; 2],
            ..Mesh::default()
        };
        let node = |name: &str| SceneNode { name: Some(name.into()), ..SceneNode::default() };
        let lamp = PunctualLight {
            node: 1,
            kind: PunctualKind::Point,
            position: Vec3::Y * HEIGHT,
            direction: Vec3::NEG_Y,
            across: [Vec3::X, Vec3::Z],
            profile: None,
            color: Vec3::ONE,
            intensity: CANDELA,
            radius_rad: 0.0,
        };
        let camera = Camera::look_at("above", Vec3::new(3.0, 5.0, 4.0), Vec3::ZERO, 0.9, 4.0 / 3.0);
        let scene = Scene {
            mesh,
            materials: vec![Material { metallic: 0.0, ..Material::default() }],
            nodes: vec![node("floor"), node("lamp")],
            cameras: vec![camera.clone()],
            punctual: if sky.is_none() { vec![lamp] } else { Vec::new() },
            ..Scene::default()
        };
        let scene = Arc::new(PreparedScene::with_sky(scene, &[], sky).unwrap().0);
        let config = BakeConfig { spp: 8, tolerance_db: 60.0, ..BakeConfig::default() };
        let irradiance = rows(&scene);
        let (passes, of) = (Passes::FinalOnly, (scene.clone(), camera.clone()));
        let job = BakeJob { scene: of.0, camera: of.1, film: FILM, config, passes, irradiance };
        let bake = job.run(|_| std::ops::ControlFlow::Continue(())).unwrap().unwrap();
        let seen = Seen::new(&scene, &camera, FILM);
        (bake, seen)
    }

    /// Pixels whose whole square sees the floor.
    fn inner(marks: &Marks) -> Marks {
        let width = FILM.width;
        let mut rim = Marks::new(FILM);
        for &pixel in marks.pixels() {
            let (x, y) = ((pixel % width) as f32, (pixel / width) as f32);
            let near = [[x - 1.0, y - 1.0], [x + 2.0, y + 2.0]];
            if Marks::rect(FILM, near).pixels().iter().any(|pixel| !marks.holds(*pixel)) {
                rim.add(&Marks::rect(FILM, [[x, y], [x + 1.0, y + 1.0]]));
            }
        }
        let mut inner = marks.clone();
        inner.remove(&rim);
        inner
    }

    #[test]
    fn a_lamp_over_a_floor_gives_candela_times_cosine_over_squared_distance() {
        let (bake, seen) = floor(None);
        let floor = seen.like(MIDDLE, Kin::Node);
        let told = of_marks(&bake, plain(), &floor, Some(&seen)).unwrap();
        assert!((told.area_m2.unwrap() / 16.0 - 1.0).abs() < 0.02, "{told:?}");
        // I cosθ / d², the mean over the square by its middles.
        let lux = |x: f32, z: f32| f64::from(CANDELA * HEIGHT / (x * x + z * z + HEIGHT * HEIGHT).powf(1.5));
        let at = |i: i32| (i as f32 + 0.5) * 0.02;
        let mean = (-100..100).flat_map(|i| (-100..100).map(move |j| lux(at(i), at(j)))).sum::<f64>() / 40_000.0;
        let inside = of_marks(&bake, plain(), &inner(&floor), Some(&seen)).unwrap();
        let most = lux(0.0, 0.0);
        assert!((inside.maximum / most - 1.0).abs() < 0.03, "{} is not {most}", inside.maximum);
        // The rim is darker than the rest, and left out.
        assert!(inside.average > mean && inside.average < 1.1 * mean, "{} for {mean}", inside.average);
        assert!(inside.minimum > lux(2.0, 2.0) && inside.minimum < 1.3 * lux(2.0, 2.0), "{inside:?}");
        assert!(told.average < mean, "the rim is half in the dark: {} for {mean}", told.average);
        // Where nothing is seen no light arrives, and none is missing.
        let all = Marks::rect(FILM, [[0.0; 2], [FILM.width as f32, FILM.height as f32]]);
        let all = of_marks(&bake, plain(), &all, Some(&seen)).unwrap();
        assert_eq!((all.points, all.minimum), (told.points, told.minimum));
    }

    #[test]
    fn a_work_plane_over_a_chosen_floor_reads_the_inverse_square_law() {
        let plane = WorkPlane { height_m: 0.5, spacing_m: Some(0.5), floor: Some(0) };
        let request = IrradianceRequest { work_planes: vec![plane], ..IrradianceRequest::default() };
        let (bake, _) = baked(None, |scene| request.rows(scene).unwrap());
        let (set, grid) = bake.grids().next().unwrap();
        assert_eq!((grid.size, grid.name.as_str()), ([8, 8], "work plane 0.5 m over floor"));
        let (rig, added) = plain();
        let points = of_grid(&bake, (set, grid), (rig, added)).unwrap();
        let above = HEIGHT - 0.5;
        let known = |x: f32, z: f32| CANDELA * above / (x * x + z * z + above * above).powf(1.5);
        for (point, lux) in &points {
            let known = known(point.x, point.z);
            assert!((lux / known - 1.0).abs() < 0.02, "{lux} lx at {point}, not {known} lx");
        }
        // U0: the corner at (1.75, 1.75) over the mean of the 64 points.
        let at = |nth: usize| nth as f32 * 0.5 - 1.75;
        let mean = (0..64).map(|nth| known(at(nth % 8), at(nth / 8))).sum::<f32>() / 64.0;
        let told = LuxFigures::of(points.iter().map(|(_, lux)| (f64::from(*lux), 1.0)));
        let u0 = f64::from(known(1.75, 1.75) / mean);
        assert!(told.points == 64 && (told.uniformity().unwrap() / u0 - 1.0).abs() < 0.03, "{told:?}, U0 {u0}");
    }

    #[test]
    fn a_uniform_sky_over_a_floor_gives_pi_times_its_radiance_everywhere() {
        let mut sky = crate::look::sky::typed("uniform").unwrap();
        crate::look::sky::load(&mut sky, std::path::Path::new("")).unwrap();
        let light = sky.light(None).unwrap();
        let (bake, seen) = floor(Some(&SkyRequest { light, form: SkyForm::Patches(1) }));
        let floor = inner(&seen.like(MIDDLE, Kin::Node));
        let told = of_marks(&bake, plain(), &floor, Some(&seen)).unwrap();
        let known = std::f64::consts::PI;
        assert!((told.average / known - 1.0).abs() < 0.02, "{told:?}");
        assert!(told.uniformity().unwrap() > 0.8 && told.diversity().unwrap() > 0.7, "{told:?}");
    }

    #[test]
    fn names_with_commas_and_quotes_stay_one_field() {
        let (mut table, points) = (Vec::new(), [(Vec3::new(0.5, 0.0, 1.0), 12.5)]);
        write_points(&mut table, [("desk, \"left\"", &points[..])]).unwrap();
        assert_eq!(String::from_utf8(table).unwrap(), "grid,x,y,z,lux\n\"desk, \"\"left\"\"\",0.5,0,1,12.5\n");
    }

    #[test]
    fn a_foot_candle_is_a_lumen_per_square_foot() {
        assert!((FOOT_CANDLE_LX * 0.3048f64.powi(2) - 1.0).abs() < 1e-12);
    }
}
