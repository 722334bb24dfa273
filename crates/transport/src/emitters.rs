//! Where the light of each column comes from: geometry to sample, and the way back from a surface to its column.

mod find;
mod surface;

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{Vec2, Vec3};
use thiserror::Error;

pub(crate) use self::find::lamp_keys;
use self::find::{Found, find_lights, muted_keys};
pub(crate) use self::surface::ShiningTriangle;
pub use self::surface::SurfaceEmitter;
pub(crate) use self::surface::SurfacePoint;

use crate::basis::{KeyMaker, LightBasis, LightSource, SourceKind};
use crate::lamps::Lamp;
use crate::light::PanelSpot;
use crate::origin::LightOrigin;
use crate::photometry::PhotometricProfile;
use crate::scene::{AlphaMode, Mesh, PunctualKind, PunctualLight, Scene, SceneNode};
use crate::sensors::parallelogram;
use crate::sky::{DomeEmitter, MapEmitter, SkyForm, SkyLight, SunEmitter, dome_columns};
use crate::stop::Stopped;

/// A node whose emissive quad is to become a panel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PanelRequest {
    /// Key of the light as in looks, else name of the node, or `node:INDEX`.
    pub node: String,
    /// Texels along each side, 4…64.
    pub resolution: u32,
}

/// A sky that is to light a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyRequest {
    /// The sky.
    pub light: SkyLight,
    /// How it enters the columns.
    pub form: SkyForm,
}

impl SkyRequest {
    /// The same with the map that is worked with: of patches the one that a file keeps.
    fn as_kept(&self) -> SkyRequest {
        let light = self.light.clone();
        let light = if self.form == SkyForm::Whole { light } else { light.storable() };
        SkyRequest { light, form: self.form }
    }
}

/// Fewest and most texels along a side of a panel.
pub const PANEL_RESOLUTION: std::ops::RangeInclusive<u32> = 4..=64;

/// How far texture coordinates may be off without having another texel, of any texture that is usual.
const UV_NOISE: f32 = 1e-4;

/// Why a scene cannot be lit as asked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LightingError {
    /// Somebody asked for that.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// A panel was asked for on a node that does not exist.
    #[error("no emissive node is named `{node}`; emissive nodes are: {known}")]
    UnknownPanelNode {
        /// Name asked for.
        node: String,
        /// Names that exist.
        known: String,
    },
    /// A panel was asked for twice.
    #[error("node `{node}` is asked to be a panel twice; ask once")]
    Twice {
        /// Key of its light.
        node: String,
    },
    /// A panel was asked for on something that is not a rectangle.
    #[error("node `{node}` cannot be a panel: {reason}; model it as one planar emissive quad")]
    NotAQuad {
        /// Name of the node.
        node: String,
        /// What is wrong with its shape.
        reason: &'static str,
    },
    /// A panel resolution out of range.
    #[error("panel `{node}` asks for {resolution} texels a side; give 4 to 64")]
    Resolution {
        /// Name of the node.
        node: String,
        /// Texels a side asked for.
        resolution: u32,
    },
}

/// What a column's light comes from.
#[derive(Clone, Debug)]
pub enum Emitter {
    /// A lamp without size.
    Punctual(PunctualLight),
    /// Triangles, sampled by area.
    Surface(SurfaceEmitter),
    /// A rectangle of texels, sampled texel by texel.
    Panel(PanelEmitter),
    /// Uniform radiance beyond all surfaces.
    Sky,
    /// A map beyond all surfaces, as it is.
    Environment(MapEmitter),
    /// A dome of patches beyond all surfaces.
    Dome(DomeEmitter),
    /// The disk of the sun, or of a directional lamp that has a size.
    Sun(SunEmitter),
    /// Unlit surfaces.
    Constant,
    /// A lamp of a look.
    Lamp(Lamp),
}

/// A light, or a texel of one, that is a flat parallelogram without texture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plate {
    pub corner: Vec3,
    /// From the corner to its two neighbors, m.
    pub edges: [Vec3; 2],
    /// Unit normal of the shining side.
    pub normal: Vec3,
    /// In m².
    pub area: f32,
    pub double_sided: bool,
    /// The white column's radiance.
    pub white: Vec3,
}

/// A panel in world space: point(u, v) = origin + u · u_edge + v · v_edge.
#[derive(Clone, Debug)]
pub struct PanelEmitter {
    /// Corner at (0, 0).
    pub origin: Vec3,
    /// Side along u in meters.
    pub u_edge: Vec3,
    /// Side along v in meters.
    pub v_edge: Vec3,
    /// Unit normal of the shining side.
    pub normal: Vec3,
    /// Texels along each side.
    pub resolution: u32,
    /// One of its triangles, for its material and UV.
    pub triangle: u32,
    /// Texture coordinates at the origin and their change along u and v, for both sets.
    pub uv_frame: [[Vec2; 3]; 2],
    /// Shines from both sides.
    pub double_sided: bool,
    /// Whether a texture changes the white column's radiance, 1 else, from place to place.
    pub textured: bool,
    /// One over `resolution`.
    pub texel_side: f32,
    /// Area of a texel, m².
    pub texel_area: f32,
}

impl PanelEmitter {
    /// World-space point at (u, v) of the panel.
    pub fn point(&self, uv: Vec2) -> Vec3 {
        self.origin + self.u_edge * uv.x + self.v_edge * uv.y
    }

    /// (u, v) of a world-space point projected onto the panel's plane; outside 0…1 when it is beside the panel.
    pub fn uv_of(&self, point: Vec3) -> Vec2 {
        let d = point - self.origin;
        let (uu, uv, vv) = (self.u_edge.length_squared(), self.u_edge.dot(self.v_edge), self.v_edge.length_squared());
        let det = (uu * vv - uv * uv).max(f32::MIN_POSITIVE);
        let (du, dv) = (d.dot(self.u_edge), d.dot(self.v_edge));
        Vec2::new((vv * du - uv * dv) / det, (uu * dv - uv * du) / det)
    }

    /// A texel by its numbers along u and v; `None` under a texture.
    pub(crate) fn plate(&self, texel: [u16; 2]) -> Option<Plate> {
        let edges = [self.u_edge, self.v_edge].map(|edge| edge * self.texel_side);
        (!self.textured).then(|| Plate {
            corner: self.origin + edges[0] * f32::from(texel[0]) + edges[1] * f32::from(texel[1]),
            edges,
            normal: self.normal,
            area: self.texel_area,
            double_sided: self.double_sided,
            white: Vec3::ONE,
        })
    }

    /// Whether a triangle has the texture coordinates of a set that those of the panel's own triangle go on to, but for part of a
    /// texel: a panel that has one color of a palette lies within one.
    fn goes_on(&self, mesh: &Mesh, triangle: u32, set: u8) -> bool {
        let set = usize::from(set.min(1));
        let [at, u_edge, v_edge] = self.uv_frame[set];
        let most = UV_NOISE + 1e-2 * (u_edge.length() + v_edge.length());
        let is_met = |&vertex: &u32| {
            let place = self.uv_of(mesh.positions[vertex as usize]);
            let own = mesh.uvs[set].get(vertex as usize).copied().unwrap_or(Vec2::ZERO);
            (at + u_edge * place.x + v_edge * place.y).distance(own) <= most
        };
        mesh.triangles[triangle as usize].iter().all(is_met)
    }

    /// Texel at (u, v), counted as in [`LightSource::columns`].
    pub fn texel(&self, uv: Vec2) -> u32 {
        let m = self.resolution as f32;
        let at = (uv * m).clamp(Vec2::ZERO, Vec2::splat(m - 0.5)).as_uvec2();
        at.y * self.resolution + at.x
    }

    /// Where a ray meets the panel's rectangle, seen from either side: distance along the ray and (u, v).
    pub fn intersect(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Vec2)> {
        let along = direction.dot(self.normal);
        let t = (self.origin - origin).dot(self.normal) / along;
        let uv = self.uv_of(origin + direction * t);
        (along != 0.0 && t > 0.0 && uv.min_element() >= 0.0 && uv.max_element() <= 1.0).then_some((t, uv))
    }
}

/// The columns and the geometry they come from.
#[derive(Clone, Debug, Default)]
pub struct Lighting {
    /// The columns.
    pub basis: LightBasis,
    /// One per source of the basis.
    pub emitters: Vec<Emitter>,
    /// Index of the source that each triangle of the mesh belongs to, [`Lighting::NONE`] for most.
    pub triangle_source: Vec<u32>,
}

impl Lighting {
    /// A triangle that emits nothing.
    pub const NONE: u32 = u32::MAX;

    /// Finds the lights of a scene. Returns warnings in words beside it.
    ///
    /// # Errors
    /// A panel request that the scene cannot answer.
    pub fn new(scene: &Scene, requests: &[PanelRequest]) -> Result<(Lighting, Vec<String>), LightingError> {
        Lighting::with_sky(scene, requests, None)
    }

    /// The same under a sky.
    ///
    /// # Errors
    /// As [`Lighting::new`].
    pub fn with_sky(
        scene: &Scene,
        requests: &[PanelRequest],
        sky: Option<&SkyRequest>,
    ) -> Result<(Lighting, Vec<String>), LightingError> {
        let mut warnings = Vec::new();
        let mut found = find_lights(scene, requests, &mut warnings)?;
        let sky = sky.map(SkyRequest::as_kept);
        add_sky_and_constant(scene, sky.as_ref(), &mut found, &mut warnings);
        // Column order differs from node order (panels come last), so emitters follow their keys.
        let mut basis = LightBasis::new(found.iter().map(|(source, _)| source.clone()).collect());
        basis.sky = sky.map(|sky| sky.light);
        basis.spots = file_spots(scene, &found);
        basis.muted = muted_keys(scene);
        let mut by_key: BTreeMap<String, Emitter> = found.into_iter().map(|(s, e)| (s.key, e)).collect();
        let emitters: Vec<Emitter> =
            basis.sources.iter().map(|s| by_key.remove(&s.key).expect("keys are unique")).collect();
        let triangle_source = assign_triangles(scene, &emitters);
        Ok((Lighting { basis, emitters, triangle_source }, warnings))
    }

    /// Some of its lights alone, by their index in `basis.sources`, in order: all others are dark, and have no columns.
    pub(crate) fn only(&self, sources: &[usize]) -> Lighting {
        let mut basis = LightBasis::new(sources.iter().map(|&source| self.basis.sources[source].clone()).collect());
        basis.sky.clone_from(&self.basis.sky);
        basis.spots.clone_from(&self.basis.spots);
        basis.spots.retain(|key, _| basis.sources.iter().any(|source| source.key == *key));
        basis.muted.clone_from(&self.basis.muted);
        self.in_columns_of(basis, sources)
    }

    /// Its lights in the columns of a basis that is made of them: `sources` are their indices in its own `basis.sources`, in the order in
    /// which they stand there.
    pub(crate) fn in_columns_of(&self, basis: LightBasis, sources: &[usize]) -> Lighting {
        let emitters = sources.iter().map(|&source| self.emitters[source].clone()).collect();
        let place = |source: &u32| {
            let place = sources.iter().position(|&kept| kept == *source as usize);
            place.map_or(Lighting::NONE, |place| place as u32)
        };
        let triangle_source = self.triangle_source.iter().map(|source| match *source {
            Lighting::NONE => Lighting::NONE,
            _ => place(source),
        });
        Lighting { basis, emitters, triangle_source: triangle_source.collect() }
    }

    /// The panels with their index in `basis.sources`.
    pub fn panels(&self) -> impl Iterator<Item = (usize, &PanelEmitter)> {
        self.emitters.iter().enumerate().filter_map(|(i, e)| match e {
            Emitter::Panel(panel) => Some((i, panel)),
            _ => None,
        })
    }

    /// The columns of the patches of the sky, if it has any; the one behind them is that of the map as it is baked.
    pub fn dome(&self) -> Option<(Range<u32>, &DomeEmitter)> {
        self.basis.sources.iter().zip(&self.emitters).find_map(|(source, emitter)| match emitter {
            Emitter::Dome(emitter) => {
                Some((source.columns.start..source.columns.start + emitter.dome.n_patches(), emitter))
            }
            _ => None,
        })
    }
}

/// Spots that the file marks on its panels, by the panels' keys.
fn file_spots(scene: &Scene, found: &Found) -> BTreeMap<String, Vec<PanelSpot>> {
    let spots = found.iter().filter_map(|(source, emitter)| match emitter {
        Emitter::Panel(panel) => {
            let node = scene.mesh.triangle_node[panel.triangle as usize];
            Some((source.key.clone(), scene.spots.get(&node)?.clone()))
        }
        _ => None,
    });
    spots.collect()
}

/// Color and strength that the file gives a node's emissive surfaces: those of its brightest material, channel by channel.
fn file_emission(scene: &Scene, triangles: &[u32]) -> (Vec3, f32) {
    let mut radiance = Vec3::ZERO;
    let mut strength: f32 = 0.0;
    for &triangle in triangles {
        let material = &scene.materials[scene.mesh.triangle_material[triangle as usize] as usize];
        radiance = radiance.max(material.emitted_radiance());
        strength = strength.max(material.emissive_strength);
    }
    (radiance / strength, strength)
}

/// A material's share of the brightest radiance of its light, per channel. A channel that the light does not emit in the
/// file takes the largest share: columns are white, so that any color can be put in place of the file's.
pub fn share_of(radiance: Vec3, brightest: Vec3) -> Vec3 {
    let emits = brightest.cmpgt(Vec3::ZERO);
    let share = Vec3::select(emits, radiance / Vec3::select(emits, brightest, Vec3::ONE), Vec3::ZERO);
    Vec3::select(emits, share, Vec3::splat(share.max_element()))
}

fn surface_source(scene: &Scene, key: String, node: &SceneNode, triangles: &[u32]) -> (LightSource, Emitter) {
    let (color, strength) = file_emission(scene, triangles);
    let emitter = SurfaceEmitter::new(scene, triangles, color * strength);
    let origin = LightOrigin::of_surface(scene, node, triangles, emitter.center());
    (LightSource { key, kind: SourceKind::Emitter, columns: 0..1, color, strength, origin }, Emitter::Surface(emitter))
}

fn panel_source(
    scene: &Scene,
    key: String,
    node: &SceneNode,
    triangles: &[u32],
    panel: PanelEmitter,
) -> (LightSource, Emitter) {
    let origin = LightOrigin::of_surface(scene, node, triangles, panel.center());
    let (color, strength) = file_emission(scene, &[panel.triangle]);
    let size_m = [panel.u_edge.length(), panel.v_edge.length()];
    let kind = SourceKind::Panel { resolution: panel.resolution, size_m };
    let columns = 0..panel.resolution * panel.resolution;
    (LightSource { key, kind, columns, color, strength, origin }, Emitter::Panel(panel))
}

/// Reads the rectangle that two triangles form; (0, 0) is the corner at UV (0, 0), else the first vertex, and u runs along
/// growing UV, else along the first edge.
fn panel_emitter(scene: &Scene, triangles: &[u32], resolution: u32) -> Result<PanelEmitter, &'static str> {
    if !PANEL_RESOLUTION.contains(&resolution) {
        return Err("its resolution is not 4 to 64");
    }
    let &[first, second] = triangles else { return Err("its emissive surface is not a single quad") };
    let mesh = &scene.mesh;
    let a = mesh.triangles[first as usize];
    let p = a.map(|v| mesh.positions[v as usize]);
    let (alone, q) = parallelogram(p, mesh.corners(second))?;
    // Corner `alone` with its two neighbors spans the quad; order the four corners round it.
    let ring = [alone, (alone + 1) % 3, 3, (alone + 2) % 3];
    let corner = |i: usize| if i == 3 { q } else { p[i] };
    let uv_at = |i: usize, set: usize| -> Option<Vec2> {
        let uvs = &mesh.uvs[set];
        let at = |i: usize| uvs.get(a[i] as usize).copied();
        if i < 3 { at(i) } else { Some(at(ring[1])? + at(ring[3])? - at(ring[0])?) }
    };
    let origin = (0..4)
        .find(|&k| uv_at(ring[k], 0).is_some_and(|uv| uv.abs().max_element() < 1e-3))
        .filter(|_| uv_at(ring[1], 0) != uv_at(ring[3], 0))
        .map(|k| (k, true));
    let (k, by_uv) = origin.unwrap_or(((0..4).find(|&k| ring[k] == 0).expect("the ring holds every corner"), false));
    let (next, previous) = (ring[(k + 1) % 4], ring[(k + 3) % 4]);
    let u_first = if by_uv {
        let along = |i: usize| uv_at(i, 0).map_or(Vec2::ZERO, |uv| uv.abs());
        along(next).x - along(next).y >= along(previous).x - along(previous).y
    } else {
        next == 1 || previous != 1
    };
    let (u_corner, v_corner) = if u_first { (next, previous) } else { (previous, next) };
    let o = ring[k];
    let (u_edge, v_edge) = (corner(u_corner) - corner(o), corner(v_corner) - corner(o));
    if u_edge.dot(v_edge).abs() > 1e-2 * u_edge.length() * v_edge.length() {
        return Err("its quad is not a rectangle");
    }
    let uv_frame = [0, 1].map(|set| {
        let at = |i| uv_at(i, set).unwrap_or(Vec2::ZERO);
        [at(o), at(u_corner) - at(o), at(v_corner) - at(o)]
    });
    if mesh.triangle_material[first as usize] != mesh.triangle_material[second as usize] {
        return Err("its two triangles have different materials");
    }
    let material = &scene.materials[mesh.triangle_material[first as usize] as usize];
    if material.alpha != AlphaMode::Opaque {
        return Err("its material is not opaque");
    }
    let normal = mesh.area_normal(first).normalize();
    if !material.double_sided && mesh.area_normal(second).dot(normal) < 0.0 {
        return Err("its two triangles shine to opposite sides");
    }
    let texel_area = u_edge.cross(v_edge).length() / (resolution * resolution) as f32;
    let panel = PanelEmitter {
        origin: corner(o),
        u_edge,
        v_edge,
        normal,
        resolution,
        triangle: first,
        uv_frame,
        double_sided: material.double_sided,
        textured: material.emissive_texture.is_some(),
        texel_side: 1.0 / resolution as f32,
        texel_area,
    };
    if material.emissive_texture.is_some_and(|texture| !panel.goes_on(mesh, second, texture.uv_set)) {
        return Err("its two triangles have pieces of their texture that do not meet");
    }
    Ok(panel)
}

fn add_sky_and_constant(scene: &Scene, sky: Option<&SkyRequest>, found: &mut Found, warnings: &mut Vec<String>) {
    let mut keys = KeyMaker::default();
    for (source, _) in found.iter() {
        keys.key(Some(&source.key), 0);
    }
    if let Some(sky) = sky {
        add_sky(sky, &mut keys, found);
    } else if found.is_empty() {
        warnings.push("the scene has no light; a uniform sky of 1 nit lights it".into());
        let source = LightSource::plain(keys.key(Some("sky"), 0), SourceKind::Sky, 0..1);
        found.push((source, Emitter::Sky));
    }
    if scene.mesh.triangle_material.iter().any(|&m| scene.materials[m as usize].unlit) {
        let source = LightSource::plain(keys.key(Some("unlit"), 0), SourceKind::Constant, 0..1);
        found.push((source, Emitter::Constant));
    }
}

fn add_sky(sky: &SkyRequest, keys: &mut KeyMaker, found: &mut Found) {
    let light = &sky.light;
    let (color, strength) = (Vec3::ONE, light.intensity);
    let (kind, n_columns, emitter) = match sky.form {
        SkyForm::Whole => (SourceKind::Sky, 1, Emitter::Environment(MapEmitter::new(light))),
        SkyForm::Patches(divisions) => {
            let emitter = DomeEmitter::new(divisions, light);
            (SourceKind::Dome { divisions }, dome_columns(divisions), Emitter::Dome(emitter))
        }
    };
    let key = keys.key(Some("sky"), 0);
    let origin = LightOrigin::default();
    found.push((LightSource { key, kind, columns: 0..n_columns, color, strength, origin }, emitter));
    if let Some((sun, direction)) = light.sun.zip(light.sun_direction()) {
        let (kind, strength) = (SourceKind::Sun { direction }, sun.illuminance_lx * light.intensity);
        let (key, origin) = (keys.key(Some("sun"), 0), LightOrigin::default());
        let source = LightSource { key, kind, columns: 0..1, color: sun.color, strength, origin };
        found.push((source, Emitter::Sun(SunEmitter::new(direction))));
    }
}

fn assign_triangles(scene: &Scene, emitters: &[Emitter]) -> Vec<u32> {
    let mut triangle_source = vec![Lighting::NONE; scene.mesh.triangles.len()];
    for (idx, emitter) in emitters.iter().enumerate() {
        match emitter {
            Emitter::Surface(surface) => {
                for t in surface.triangles.iter().map(|t| t.triangle) {
                    triangle_source[t as usize] = idx as u32;
                }
            }
            Emitter::Panel(panel) => {
                let node = scene.mesh.triangle_node[panel.triangle as usize];
                for (t, slot) in triangle_source.iter_mut().enumerate() {
                    let material = &scene.materials[scene.mesh.triangle_material[t] as usize];
                    if scene.mesh.triangle_node[t] == node && material.is_emitter() {
                        *slot = idx as u32;
                    }
                }
            }
            Emitter::Constant => {
                for (t, slot) in triangle_source.iter_mut().enumerate() {
                    if scene.materials[scene.mesh.triangle_material[t] as usize].unlit {
                        *slot = idx as u32;
                    }
                }
            }
            _ => {}
        }
    }
    triangle_source
}

/// Intensity of a lamp at strength 1 towards a unit direction in world space: what its profile measures there over the most
/// it measures, else glTF's spot falloff `saturate(cosθ · scale + offset)²`, see `spot_rise`.
pub fn punctual_falloff(light: &PunctualLight, profiles: &[PhotometricProfile], toward: Vec3) -> f32 {
    if let Some(profile) = light.profile.and_then(|profile| profiles.get(profile as usize)) {
        let [x, y] = light.across.map(|axis| toward.dot(axis));
        return profile.candela(Vec3::new(x, y, -toward.dot(light.direction))) / profile.max_candela();
    }
    match light.kind {
        PunctualKind::Spot { inner_rad, outer_rad } => {
            let [rim, rise] = spot_rise(inner_rad, outer_rad);
            // One minus the cosine, exact in narrow cones as well.
            let t = ((rim - 0.5 * toward.distance_squared(light.direction)) / rise).clamp(0.0, 1.0);
            t * t
        }
        PunctualKind::Point | PunctualKind::Directional => 1.0,
    }
}

/// Where a spot begins, by one minus the cosine of the angle to its axis, and within how much of that it rises to its full
/// intensity: glTF's recommended 0.001 at least, but half of a narrow cone, of which the axis would be out of reach else.
pub(crate) fn spot_rise(inner_rad: f32, outer_rad: f32) -> [f32; 2] {
    let [inner, rim] = [inner_rad, outer_rad].map(|angle| 2.0 * (0.5 * angle).sin().powi(2));
    [rim, (rim - inner).max((0.5 * rim).min(0.001)).max(f32::MIN_POSITIVE)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_share_what_their_light_emits_and_are_white_where_it_emits_nothing() {
        let brightest = Vec3::new(4.0, 2.0, 0.0);
        assert_eq!(share_of(brightest, brightest), Vec3::ONE);
        assert_eq!(share_of(Vec3::new(1.0, 1.0, 0.0), brightest), Vec3::new(0.25, 0.5, 0.5));
        assert_eq!(share_of(Vec3::new(0.0, 2.0, 0.0), brightest), Vec3::new(0.0, 1.0, 1.0));
        assert_eq!(share_of(Vec3::splat(1e-40), Vec3::splat(1e-40)), Vec3::ONE);
    }

    #[test]
    fn a_spot_has_its_full_intensity_on_its_axis_however_narrow_it_is() {
        let direction = Vec3::new(0.6, -0.64, 0.48);
        let across = [Vec3::new(0.8, 0.48, -0.36), Vec3::new(0.0, 0.6, 0.8)];
        let falloff = |[inner, outer]: [f32; 2], at: f32| {
            let [inner_rad, outer_rad, at_rad] = [inner, outer, at].map(f32::to_radians);
            let light = PunctualLight {
                node: 0,
                kind: PunctualKind::Spot { inner_rad, outer_rad },
                position: Vec3::ZERO,
                direction,
                across,
                profile: None,
                color: Vec3::ONE,
                intensity: 1.0,
                radius_rad: 0.0,
            };
            punctual_falloff(&light, &[], direction * at_rad.cos() + across[0] * at_rad.sin())
        };
        for cone in [[0.0, 0.1], [0.0, 1.0], [1.0, 1.0], [0.0, 2.0], [10.0, 30.0], [0.0, 90.0]] {
            let on_axis = falloff(cone, 0.0);
            assert!((on_axis - 1.0).abs() < 1e-3, "{cone:?}: {on_axis}");
            assert_eq!(falloff(cone, 1.01 * cone[1]), 0.0, "{cone:?}");
        }
        assert!(falloff([0.5, 1.0], 0.49) == 1.0 && falloff([0.5, 1.0], 0.6) < 0.95);
        assert_eq!(falloff([0.0, 0.0], 0.0), 0.0);
    }
}
