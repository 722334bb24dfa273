//! Lamps that no bake knew: what patches and live light make of them, against traced pictures of the same lamps.

mod drawn;
pub mod live;
pub mod more;
pub mod places;
pub mod spent;
pub mod sun;
pub mod tables;
mod twins;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clerestory_nystrom::PackedMatrix;
use clerestory_transport::archive;
use clerestory_transport::bake::{Bake, BakeConfig};
use clerestory_transport::bvh::Ray;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::import;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit, PreparedLamps};
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::patches::{DEFAULT_PATCHES, NARROW_ALPHA};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sampler::{Sampler, uniform_hash};
use clerestory_transport::scene::Scene;
use clerestory_transport::trace::TraceConfig;
use glam::{Vec2, Vec3};

use self::drawn::{Drawn, Moved};
use self::live::View;
use self::places::{Pictures, Place};
use self::spent::{Spent, bake};
use self::tables::{Bytes, Goals, Told};
use super::desk::Desk;
use super::rendered::{relit, rendered};
use super::scenes;

/// Names of the sections, and what headings of the others end with, so that none stands twice on the page.
const OWN: &str = "lamps";
pub const OTHERS: &str = "lamps-others";
const OF_OTHERS: &str = ", in scenes of others";
pub const LIVING_ROOM: &str = "lamps-living-room";
const OF_LIVING_ROOM: &str = ", under a sky";

/// Strength of the lamp, lm.
const LUMEN: f32 = 1500.0;
/// Widths of the pictures: those that are held against references, and those whose bake is timed.
const WIDTHS: [u32; 2] = [64, 320];
/// Samples per pixel of a bake of each width.
const BAKE_SPP: [u32; 2] = [256, 32];
/// Patches and samples per pixel of the bakes that are held against references.
const BAKES: [[u32; 2]; 6] = [
    [DEFAULT_PATCHES / 4, BAKE_SPP[0]],
    [DEFAULT_PATCHES / 2, BAKE_SPP[0]],
    USUAL,
    [DEFAULT_PATCHES, BAKE_SPP[0] / 4],
    [DEFAULT_PATCHES, 2 * BAKE_SPP[0]],
    [4 * DEFAULT_PATCHES, BAKE_SPP[0]],
];
/// The one that goals are set for, and the one in a hurry.
const USUAL: [u32; 2] = [DEFAULT_PATCHES, BAKE_SPP[0]];
const QUICK: [u32; 2] = [DEFAULT_PATCHES, 64];

/// A measured distribution, wide and to one side.
const PROFILE: &str = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 7 5 1 2 0 0 0\n1 1 10\n0 15 30 45 60 75 90\n0 90 180 270 360\n\
    400 520 640 560 320 120 0\n400 420 380 260 140 40 0\n400 300 180 90 40 10 0\n400 420 380 260 140 40 0\n\
    400 520 640 560 320 120 0\n";

/// Samples per pixel of traced and of live light, in a hurry and in full.
const TRACED_SPP: [u32; 2] = [256, 2048];

/// A scene in which a lamp is moved.
pub(super) struct Case {
    pub name: &'static str,
    pub path: PathBuf,
    /// The map that its sky has.
    pub sky: Option<PathBuf>,
    /// What is changed in it before it is prepared; such a scene has no sky.
    pub change: Option<Change>,
}

/// Changes a scene.
pub(super) type Change = fn(&mut Scene) -> Result<()>;

impl Case {
    /// The scene, and what it is seen from.
    pub fn prepared(&self) -> Result<(PreparedScene, Camera)> {
        self.under(self.sky.as_deref())
    }

    /// The same without its sky.
    fn without_sky(&self) -> Result<(PreparedScene, Camera)> {
        self.under(None)
    }

    fn under(&self, sky: Option<&Path>) -> Result<(PreparedScene, Camera)> {
        let scene = match self.change {
            None => scenes::prepared(&self.path, sky.map(|map| ("sky", map)))?,
            Some(change) => {
                ensure!(sky.is_none(), "a scene that is changed has no sky");
                let loaded = import::load(&self.path);
                let mut scene = loaded.with_context(|| format!("cannot load {}", self.path.display()))?.scene;
                change(&mut scene)?;
                PreparedScene::new(scene, &[])?.0
            }
        };
        let camera = scene.scene.cameras.first().context("no camera")?.clone();
        Ok((scene, camera))
    }
}

/// Tables of the scene of our own.
pub fn write(desk: &Desk) -> Result<String> {
    measured(desk, (OWN, ""), own(desk))
}

/// Tables of the scenes of others that are at hand: with its own beside them the section would take more than half an hour.
///
/// # Errors
/// As [`write()`].
pub fn write_others(desk: &Desk) -> Result<String> {
    measured(desk, (OTHERS, OF_OTHERS), others(desk))
}

/// Tables of the one under a sky, apart for the same reason.
///
/// # Errors
/// As [`write()`].
pub fn write_living_room(desk: &Desk) -> Result<String> {
    measured(desk, (LIVING_ROOM, OF_LIVING_ROOM), living_room(desk))
}

/// Whether there are any: without them the page keeps what was measured elsewhere.
pub fn has_others(desk: &Desk) -> bool {
    !others(desk).is_empty()
}

/// Whether the one under a sky is at hand.
pub fn has_living_room(desk: &Desk) -> bool {
    !living_room(desk).is_empty()
}

/// Tables of some scenes; `of` is what their headings end with.
fn measured(desk: &Desk, (section, of): (&str, &str), cases: Vec<Case>) -> Result<String> {
    ensure!(!cases.is_empty(), "its scenes lie in the folder that CLERESTORY_SHARED names, and are not there");
    let (mut tables, mut goals) = (Told::default(), Vec::new());
    for case in cases {
        desk.say(&format!("lamps in {}", case.name));
        let why = || format!("cannot move lamps in {}", case.name);
        let told: Told = desk.part(section, case.name, || measure(desk, &case).with_context(why))?;
        let wide = || timed(desk, &case).with_context(why);
        let spent: Spent = desk.part(section, &format!("{}, timed", case.name), wide)?;
        let mut of_scene = told.goals.clone();
        if section == OWN {
            let added = || twins::added(desk, &case.path).with_context(why);
            of_scene.exchanged.extend(desk.part(section, "lamps put in", added)?);
        }
        goals.push((case.name, of_scene, spent));
        tables.add(&told);
    }
    Ok(tables.page(&goals, of, desk))
}

pub(super) fn cases(desk: &Desk) -> Vec<Case> {
    let all = own(desk).into_iter().chain(others(desk)).chain(living_room(desk));
    all.take(desk.choose(1, usize::MAX)).collect()
}

fn own(desk: &Desk) -> Vec<Case> {
    vec![Case { name: "gallery", path: desk.root.join("assets/scenes/gallery.glb"), sky: None, change: None }]
}

fn others(desk: &Desk) -> Vec<Case> {
    let all = [("conference", "conference"), ("staircase2", "bitterli-staircase2")];
    let cases = all.into_iter().filter_map(|(name, file)| of_others(desk, name, file, None));
    cases.take(desk.choose(1, usize::MAX)).collect()
}

fn living_room(desk: &Desk) -> Vec<Case> {
    let sky = desk.shared("env/bitterli-living-room-sky19.exr");
    of_others(desk, "living-room", "bitterli-living-room", sky).into_iter().collect()
}

/// A scene of others and its sky, if it is at hand.
fn of_others(desk: &Desk, name: &'static str, file: &str, sky: Option<PathBuf>) -> Option<Case> {
    let path = desk.shared(&format!("scenes/{file}.glb"))?;
    Some(Case { name, path, sky, change: None })
}

/// Lamps of a scene, the light that belongs to it, and two traced and live pictures of each.
struct Traced {
    drawn: Vec<Drawn>,
    /// Places that drowned.
    n_drowned: usize,
    of_file: [Vec<f32>; 2],
    twins: Vec<twins::Twin>,
    /// With narrow lobes, those of the twins behind those of the lamps.
    live: [Vec<Vec<f32>>; 2],
}

impl Traced {
    fn find(case: &Case, view: View<'_>, moved: &Moved, twins: Vec<twins::Twin>) -> Result<Traced> {
        let coefficients = view.scene.lighting.basis.project(&LightRig::default());
        let of_file = traced(view.scene, view.film, &coefficients, view.n_samples, [1, 2])?;
        let (drawn, n_drowned) = drawn::draw(case, view, moved)?;
        let own = drawn.iter().map(|drawn| &drawn.lamp);
        let all: Vec<&PreparedLamps> = own.chain(twins.iter().map(|twin| &twin.free)).collect();
        let live = [view.live(&all, 1, NARROW_ALPHA)?, view.live(&all, 2, NARROW_ALPHA)?];
        Ok(Traced { drawn, n_drowned, of_file, twins, live })
    }

    /// What a bake makes of the lamps.
    fn places(&self, scene: &PreparedScene, bake: &Bake) -> Result<Vec<Place>> {
        let patches = bake.header.patches.as_ref().context("no patches")?;
        ensure!(patches.narrow_alpha() == NARROW_ALPHA, "patches leave out other lobes than the live light shows");
        let own = relit(bake, &bake.header.coefficients(&LightRig::default()));
        let place = |(nth, drawn): (usize, &Drawn)| {
            let lit = drawn.lamp.light_on_patches(scene, patches, bake.header.config.bounces);
            let indirect = relit(bake, &of_patches(bake, lit));
            let pictures = Pictures {
                of_patches: &indirect,
                live: [&self.live[0][nth], &self.live[1][nth]],
                direct: drawn.direct.each_ref().map(Vec::as_slice),
                references: drawn.traced.each_ref().map(Vec::as_slice),
                own: &own,
                own_references: self.of_file.each_ref().map(Vec::as_slice),
            };
            pictures.place(drawn.number, drawn.height_m)
        };
        Ok(self.drawn.iter().enumerate().map(place).collect())
    }

    /// Lamps of the file exchanged for free ones, kind and dB of each.
    fn exchanged(&self, scene: &PreparedScene, bake: &Bake) -> Result<Vec<(String, f64)>> {
        let first = self.drawn.len();
        let of_twin = |(nth, twin): (usize, &twins::Twin)| {
            let db = twin.db(scene, bake, [&self.live[0][first + nth], &self.live[1][first + nth]]);
            db.map(|db| (twin.kind.to_owned(), db))
        };
        self.twins.iter().enumerate().map(of_twin).collect()
    }
}

fn measure(desk: &Desk, case: &Case) -> Result<Told> {
    let (scene, camera) = case.prepared()?;
    let scene = Arc::new(scene);
    let film = Film::of_width(WIDTHS[0], &camera);
    let (n_places, n_samples) = desk.choose((3, TRACED_SPP[0]), (10, TRACED_SPP[1]));
    let view = View { scene: &scene, camera: &camera, film, n_samples };
    let moved = Moved { shapes: vec![LampShape::Point], n_places, clear_m: 0.0, lamp };
    let traced = Traced::find(case, view, &moved, twins::find(&scene)?)?;
    let mut told = Told::default();
    for &[n_patches, spp] in desk.choose(&[QUICK][..], &BAKES) {
        let config = BakeConfig { spp, patches: n_patches, ..BakeConfig::default() };
        let (bake, spent) = bake(&scene, &camera, film, config)?;
        let (places, bytes) = (traced.places(&scene, &bake)?, Bytes::of(desk, &bake)?);
        let patches = bake.header.patches.as_ref().context("no patches")?;
        told.add_row((case.name, spp), (&places, traced.n_drowned), (patches, bytes, spent));
        desk.say(&format!("{} with {} patches, {spp} samples: {places:.3?}", case.name, patches.n_patches()));
        if [n_patches, spp] == desk.choose(QUICK, USUAL) {
            told.add_places(case.name, &places);
            told.goals = Goals::of(&places, traced.exchanged(&scene, &bake)?);
        }
    }
    Ok(told)
}

/// CPU seconds of a bake that is large enough for what patches learn to count as it does in bakes for people.
fn timed(desk: &Desk, case: &Case) -> Result<Spent> {
    let (scene, camera) = case.prepared()?;
    let film = Film::of_width(desk.choose(WIDTHS[0], WIDTHS[1]), &camera);
    let config = BakeConfig { spp: desk.choose(16, BAKE_SPP[1]), patches: DEFAULT_PATCHES, ..BakeConfig::default() };
    Ok(bake(&Arc::new(scene), &camera, film, config)?.1)
}

impl Bytes {
    /// Of the files of a bake, and of the same without its patches.
    fn of(desk: &Desk, bake: &Bake) -> Result<Bytes> {
        let size = |bake: &Bake| {
            let path = desk.file("lamps.transport");
            archive::write(bake, Path::new(&path))?;
            Ok::<_, anyhow::Error>(std::fs::metadata(path)?.len())
        };
        let (all, without) = (size(bake)?, size(&without_patches(bake))?);
        Ok(Bytes { without, of_patches: all - without })
    }
}

/// The same bake as if nobody had asked for patches: its other columns do not depend on them.
fn without_patches(bake: &Bake) -> Bake {
    let (mut header, mut groups) = ((*bake.header).clone(), bake.groups.clone());
    if header.patches.take().is_some() {
        header.config.patches = 0;
        let n_columns = header.basis.groups.pop().map_or(0, |group| group.columns.len());
        header.column_scale.truncate(header.column_scale.len() - n_columns);
        groups.pop();
    }
    let n_groups = groups.len();
    let packed = bake.packed.as_ref().map(|packed| {
        let of_lights = |groups: &Vec<PackedMatrix>| groups[..n_groups].to_vec();
        Arc::new(packed.iter().map(of_lights).collect())
    });
    Bake { header: Arc::new(header), groups, irradiance: Vec::new(), packed }
}

/// Coefficients of a bake under nothing but the light of its patches.
fn of_patches(bake: &Bake, light: Vec<[f32; 3]>) -> Vec<Vec<[f32; 3]>> {
    let groups = &bake.header.basis.groups;
    let mut coefficients: Vec<_> = groups.iter().map(|group| vec![[0.0; 3]; group.columns.len()]).collect();
    if let Some(last) = coefficients.last_mut() {
        *last = light;
    }
    coefficients
}

/// Two path-traced pictures with seeds of their own.
fn traced(scene: &PreparedScene, film: Film, light: &[[f32; 3]], spp: u32, seeds: [u64; 2]) -> Result<[Vec<f32>; 2]> {
    let traced = |seed| rendered(scene, film, light, &TraceConfig { spp, bounces: None, seed });
    let [a, b] = seeds.map(|seed| traced(seed).map(|picture| picture.pixels.into_flattened()));
    Ok([a?, b?])
}

pub(super) fn lamp(shape: LampShape, position: Vec3) -> FreeLamp {
    let (aim, unit, setting) = (position - Vec3::Y, LampUnit::Lumen, LightSetting::default());
    FreeLamp {
        key: "a lamp of the report".into(),
        shape,
        position,
        aim,
        strength: LUMEN,
        unit,
        setting,
        turn_rad: 0.0,
        replaces: None,
    }
}

/// A lamp with a measured distribution, which is written to a file.
pub(super) fn profile(file: String) -> Result<LampShape> {
    std::fs::write(&file, PROFILE).with_context(|| format!("cannot write {file}"))?;
    Ok(LampShape::Profile { file })
}

/// A place in the open space before the camera: between a surface that it sees and another one that is seen from there.
pub(super) fn place(scene: &PreparedScene, camera: &Camera, film: Film, nth: u32) -> Vec3 {
    let u = |key: u64| uniform_hash(0x1A_4F00 + u64::from(nth) * 16 + key);
    let film_px = Vec2::new(u(0) * film.width as f32, u(1) * film.height as f32);
    let ray = |origin, direction| Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    let mut sampler = Sampler::new(1, 1, 1);
    let first = ray(camera.position(), camera.direction(film, film_px));
    let Some(hit) = scene.closest(&first, &mut sampler) else { return camera.position() };
    let normal = if hit.normal.dot(first.direction) > 0.0 { -hit.normal } else { hit.normal };
    let z = 1.0 - 2.0 * u(3);
    let (sin, cos) = (std::f32::consts::TAU * u(4)).sin_cos();
    let aside = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
    let next = ray(hit.origin(normal), (aside + normal).normalize_or(normal));
    let free = scene.closest(&next, &mut sampler).map_or(1.0, |hit| hit.t);
    next.origin + next.direction * free * (0.1 + 0.8 * u(2))
}

#[cfg(test)]
mod tests {
    use clerestory::headless::GALLERY;
    use clerestory_transport::photometry::PhotometricProfile;

    use super::*;

    #[test]
    fn the_distribution_is_read_without_a_remark_and_shines_to_one_side() {
        let folder = tempfile::tempdir().unwrap();
        let shape = profile(folder.path().join("lamp.ies").display().to_string()).unwrap();
        assert_eq!(shape.name(), "ies");
        let (lamps, remarks) = PreparedLamps::new(&[lamp(shape, Vec3::Y)], None).unwrap();
        assert!(remarks.is_empty(), "{remarks:?}");
        assert!(!lamps.is_empty());
        let profile = PhotometricProfile::parse(PROFILE.as_bytes(), "lamp.ies").unwrap();
        let sides = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y];
        assert_eq!(sides.map(|side| profile.candela(side + Vec3::NEG_Z).round()), [560.0, 260.0, 90.0, 260.0]);
    }

    #[test]
    fn a_bake_without_its_patches_is_one_that_never_had_any() {
        let scene = import::load_bytes("gallery.glb", GALLERY).unwrap().scene;
        let scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
        let (camera, film) = (scene.scene.cameras[0].clone(), Film { width: 16, height: 12 });
        let baked = |patches: u32| {
            let config = BakeConfig { spp: 2, patches, ..BakeConfig::default() };
            bake(&scene, &camera, film, config).unwrap()
        };
        let ((with, spent), (plain, plain_spent)) = (baked(32), baked(0));
        assert!(spent.learning > 0.0 && spent.lights > 0.0 && plain_spent.walks == 0.0, "{spent:?} {plain_spent:?}");
        let without = without_patches(&with);
        assert_eq!((without.groups.len(), with.groups.len()), (plain.groups.len(), plain.groups.len() + 1));
        let coefficients = plain.header.coefficients(&LightRig::default());
        assert_eq!(without.header.coefficients(&LightRig::default()), coefficients);
        assert_eq!(relit(&without, &coefficients), relit(&plain, &coefficients));
        let n_bytes = |bake: &Bake| {
            let packed = bake.packed.as_ref().unwrap();
            packed.iter().flatten().map(PackedMatrix::n_bytes).sum::<usize>()
        };
        assert_eq!(n_bytes(&without), n_bytes(&plain));
        assert!(n_bytes(&with) > n_bytes(&plain));
    }
}
