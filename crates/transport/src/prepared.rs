//! A scene made ready for rays: bounding volume hierarchies, lights, and surface lookups.

use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

use crate::bsdf::{self, Bsdf, FinishParams, Frame, SurfaceParams, coat_table};
use crate::bvh::{Aabb, Bvh, Hit, Ray, TreeWords};
use crate::casters::Casters;
use crate::clearance::{clearance, nearer, offset_origin, rounding, shortening};
use crate::emitters::{Emitter, Lighting, LightingError, PanelRequest, SkyRequest};
use crate::enclosed;
use crate::nested;
use crate::remote;
use crate::sampler::Sampler;
use crate::scene::{AlphaMode, Material, Scene};
use crate::sheets;
use crate::skips::{Skip, Skips, Spared};
use crate::slabs::{Slabs, hidden};
use crate::stop::Stop;
use crate::unlit;

/// A scene with its lights, ready to be traced.
#[derive(Clone)]
pub struct PreparedScene {
    /// The scene.
    pub scene: Scene,
    /// Its columns.
    pub lighting: Lighting,
    /// Work that is left out.
    pub skips: Skips,
    /// Opaque triangles.
    solid: Arc<Bvh>,
    /// Triangles with alpha and clear panes, `None` where the scene has none: shadow rays may pass them.
    sheer: Option<Arc<Bvh>>,
    /// Unlit triangles, `None` where the scene has none: they are seen, and light passes them.
    unlit: Option<Arc<Bvh>>,
    /// Whether a material attenuates light inside (KHR_materials_volume).
    pub attenuates: bool,
    /// Whether shadow rays may pass each material as walks do.
    clear_panes: Arc<[bool]>,
    /// Solid panes that connections pass.
    pub(crate) slabs: Arc<Slabs>,
    /// Mirrors and clear bodies that walks are sent toward, `None` where they throw no light that a walk could meet.
    pub(crate) casters: Option<Arc<Casters>>,
    /// Whether pixels may share walks from and to coated surfaces.
    pub(crate) coats_share: bool,
    /// Whether pixels of one color of a chessboard may judge those of the other one.
    pub(crate) colors_judge: bool,
    /// Whether nodes of shared light are dimmed that outshine those around them.
    pub(crate) nodes_are_calmed: bool,
    /// Whether the samples of a pixel are stratified together.
    pub(crate) samples_are_stratified: bool,
    /// Whether the first vertex of a walk connects to all lights.
    pub(crate) connects_to_all: bool,
    /// Diagonal of all surfaces, m; infinite where there are none.
    extent: f32,
}

/// What a ray met.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceHit {
    /// Triangle of the mesh.
    pub triangle: u32,
    /// Distance along the ray in units of its direction.
    pub t: f32,
    /// World-space point on the triangle.
    pub position: Vec3,
    /// Barycentric coordinates of all three vertices.
    pub barycentric: Vec3,
    /// Unit geometric normal of the front side.
    pub normal: Vec3,
    /// Distance from the surface below which a ray may meet the triangle again, for all that rounding does to its size and
    /// to a place beyond `extent`, m.
    pub clearance: f32,
    /// Diagonal of the scene, m.
    pub extent: f32,
}

/// What a point of a surface is made of.
pub(crate) struct Appearance {
    pub params: SurfaceParams,
    pub finish: Option<FinishParams>,
    /// Unit shading normal on the front side.
    pub ns: Vec3,
}

impl SurfaceHit {
    /// Unit geometric normal of the side that `towards` looks out of.
    #[inline]
    pub(crate) fn outward(&self, towards: Vec3) -> Vec3 {
        if self.normal.dot(towards) < 0.0 { -self.normal } else { self.normal }
    }

    /// Where a ray begins that leaves to the side of `normal`, which is this hit's or its opposite.
    #[inline]
    pub fn origin(&self, normal: Vec3) -> Vec3 {
        offset_origin(self.position + normal * self.clearance, normal, self.extent)
    }
}

impl PreparedScene {
    /// Builds the hierarchies and finds the lights. Returns warnings in words beside it.
    ///
    /// # Errors
    /// A panel request that the scene cannot answer.
    pub fn new(scene: Scene, panels: &[PanelRequest]) -> Result<(PreparedScene, Vec<String>), LightingError> {
        PreparedScene::with_sky(scene, panels, None)
    }

    /// The same under a sky.
    ///
    /// # Errors
    /// As [`PreparedScene::new`].
    pub fn with_sky(
        scene: Scene,
        panels: &[PanelRequest],
        sky: Option<&SkyRequest>,
    ) -> Result<(PreparedScene, Vec<String>), LightingError> {
        PreparedScene::with_skips(scene, panels, sky, Skips::default())
    }

    /// The same, and only some work is left out.
    ///
    /// # Errors
    /// As [`PreparedScene::new`].
    pub fn with_skips(
        scene: Scene,
        panels: &[PanelRequest],
        sky: Option<&SkyRequest>,
        skips: Skips,
    ) -> Result<(PreparedScene, Vec<String>), LightingError> {
        PreparedScene::until(scene, panels, sky, skips, &Stop::default())
    }

    /// The same as [`PreparedScene::with_skips`], if nobody asks for a stop meanwhile.
    ///
    /// # Errors
    /// As [`PreparedScene::new`], and [`LightingError::Stopped`].
    pub fn until(
        scene: Scene,
        panels: &[PanelRequest],
        sky: Option<&SkyRequest>,
        skips: Skips,
        stop: &Stop,
    ) -> Result<(PreparedScene, Vec<String>), LightingError> {
        stop.check()?;
        let (lighting, mut warnings) = Lighting::with_sky(&scene, panels, sky)?;
        let clear = |material: &Material| material.is_clear_by(|| bsdf::least_roughness(material, &scene.textures));
        let clear_panes: Arc<[bool]> = scene.materials.iter().map(clear).collect();
        let is_solid = |t: &u32| {
            let material = scene.mesh.triangle_material[*t as usize] as usize;
            skips.has(Skip::Alpha) && is_never_asked(&scene.materials[material], clear_panes[material])
        };
        let is_unlit = |t: &u32| scene.materials[scene.mesh.triangle_material[*t as usize] as usize].unlit;
        let (unlit, lit): (Vec<u32>, Vec<u32>) = (0..scene.mesh.triangles.len() as u32).partition(is_unlit);
        let (solid, sheer): (Vec<u32>, Vec<u32>) = lit.into_iter().partition(is_solid);
        let build = |ids: &[u32]| {
            let corners: Vec<[Vec3; 3]> = ids.iter().map(|&t| scene.mesh.corners(t)).collect();
            Bvh::build_until(&corners, ids, stop).map(Arc::new)
        };
        let any = |ids: &[u32]| (!ids.is_empty()).then(|| build(ids)).transpose();
        let (solid, sheer, unlit) = (build(&solid)?, any(&sheer)?, any(&unlit)?);
        let attenuates = scene.materials.iter().any(|m| m.thickness > 0.0 && m.attenuation_distance.is_finite());
        let slabs = Arc::new(Slabs::find(&scene));
        stop.check()?;
        let extent = diagonal([Some(&*solid), sheer.as_deref(), unlit.as_deref()]);
        let mut prepared = PreparedScene {
            scene,
            lighting,
            skips,
            solid,
            sheer,
            unlit,
            attenuates,
            clear_panes,
            slabs,
            casters: None,
            coats_share: true,
            colors_judge: true,
            nodes_are_calmed: true,
            samples_are_stratified: true,
            connects_to_all: true,
            extent,
        };
        prepared.casters = Casters::find(&prepared, stop)?.map(Arc::new);
        warnings.extend(remote::warning(&prepared.scene));
        warnings.extend(hidden::warnings(&prepared));
        warnings.extend(enclosed::warnings(&prepared));
        warnings.extend(sheets::warning(&prepared));
        warnings.extend(nested::warning(&prepared));
        warnings.extend(unlit::brighten(&mut prepared));
        stop.check()?;
        Ok((prepared, warnings))
    }

    /// What rays of a device meet, in plain words.
    pub fn tree_words(&self) -> TreeWords {
        TreeWords { slabs: self.slabs.words(self), ..TreeWords::new(&self.solid, self.sheer.as_deref()) }
    }

    /// What coats leave to what is below them, and what rough metal gets of light scattered repeatedly, as a table for a device.
    pub fn coat_table(&self) -> Vec<f32> {
        coat_table(self.scene.facet_scattering())
    }

    /// Nearest surface along a ray that light meets; surfaces with alpha are there with their coverage as probability.
    pub fn closest(&self, ray: &Ray, sampler: &mut Sampler) -> Option<SurfaceHit> {
        self.nearest_lit(ray, sampler).map(|hit| self.surface_hit(&hit))
    }

    /// Nearest surface along a ray that a viewer looks along: the same, and unlit surfaces.
    pub fn closest_seen(&self, ray: &Ray, sampler: &mut Sampler) -> Option<SurfaceHit> {
        let nearest = self.nearest_lit(ray, sampler);
        self.nearer_sheer(self.unlit.as_deref(), ray, nearest, sampler).map(|hit| self.surface_hit(&hit))
    }

    /// What [`PreparedScene::closest_seen`] finds for each of up to 16 rays from one point, each with random numbers of its own; as
    /// many rays as there are samplers.
    pub(crate) fn closest_seen16(
        &self,
        origin: Vec3,
        directions: &[Vec3; 16],
        samplers: &mut [Sampler],
    ) -> [Option<SurfaceHit>; 16] {
        let n = samplers.len();
        let mut nearest = self.solid.closest16(origin, directions, n, 0.0, &[f32::INFINITY; 16]);
        for tree in [&self.sheer, &self.unlit].into_iter().flatten() {
            let t_max = nearest.map(|hit| hit.map_or(f32::INFINITY, |hit| hit.t));
            let before = tree.closest16(origin, directions, n, 0.0, &t_max);
            for (nth, sampler) in samplers.iter_mut().enumerate() {
                let ray = Ray { origin, direction: directions[nth], t_min: 0.0, t_max: t_max[nth] };
                nearest[nth] = self.first_there(tree, ray, before[nth], sampler).or(nearest[nth]);
            }
        }
        nearest.map(|hit| hit.map(|hit| self.surface_hit(&hit)))
    }

    /// The nearest triangle that light meets.
    #[inline]
    fn nearest_lit(&self, ray: &Ray, sampler: &mut Sampler) -> Option<Hit> {
        self.nearer_sheer(self.sheer.as_deref(), ray, self.solid.closest(ray), sampler)
    }

    /// The nearest triangle before another one, or that.
    #[inline]
    fn nearer_sheer(&self, tree: Option<&Bvh>, ray: &Ray, nearest: Option<Hit>, sampler: &mut Sampler) -> Option<Hit> {
        let Some(tree) = tree else { return nearest };
        let segment = Ray { t_max: nearest.as_ref().map_or(ray.t_max, |hit| hit.t), ..*ray };
        let met = tree.closest(&segment);
        self.first_there(tree, segment, met, sampler).or(nearest)
    }

    /// The first triangle along a segment that is there, beginning with the closest one, which is given. Those that are not are
    /// passed one by one.
    #[inline]
    fn first_there(&self, tree: &Bvh, segment: Ray, closest: Option<Hit>, sampler: &mut Sampler) -> Option<Hit> {
        let (mut segment, mut closest) = (segment, closest);
        while let Some(hit) = closest {
            let alpha = self.alpha(hit.triangle, barycentric_of(&hit));
            if alpha >= 1.0 || sampler.next_1d() < alpha {
                return Some(hit);
            }
            segment.t_min = next_after(hit.t);
            closest = tree.closest(&segment);
        }
        None
    }

    /// Nearest surface along a ray as [`PreparedScene::closest`] has it, but for clear panes, and what these let through.
    pub(crate) fn closest_behind_panes(&self, ray: &Ray, sampler: &mut Sampler) -> Option<(SurfaceHit, Vec3)> {
        let (mut ray, mut passed) = (*ray, Vec3::ONE);
        loop {
            let hit = self.closest(&ray, sampler)?;
            if !self.is_clear_pane(hit.triangle) {
                return Some((hit, passed));
            }
            passed *= self.bsdf(&hit, -ray.direction).straight_through();
            ray.t_min = next_after(hit.t);
        }
    }

    /// Nearest surface along a ray that a viewer looks along who looks through panes, clear ones and solid ones, whose shift is
    /// left out: what is behind them, or the first of them where nothing is.
    pub fn closest_behind_glass(&self, ray: &Ray, sampler: &mut Sampler) -> Option<SurfaceHit> {
        let (mut ray, mut first) = (*ray, None);
        while let Some(hit) = self.closest_seen(&ray, sampler) {
            if !self.is_clear_pane(hit.triangle) && !self.slabs.has(hit.triangle) {
                return Some(hit);
            }
            ray.t_min = next_after(hit.t);
            first = first.or(Some(hit));
        }
        first
    }

    /// Share of light that passes from `origin` to `target`: 0 behind a solid surface, less than 1 behind a clear pane.
    pub fn transmittance(&self, origin: Vec3, target: Vec3) -> Vec3 {
        let ray = shadow_ray(origin, nearer(origin, target, shortening(origin, self.extent)));
        if self.solid.occluded(&ray) { Vec3::ZERO } else { self.sheer_transmittance(ray) }
    }

    /// The share of light that passes from `origin` to each of up to 16 targets.
    pub fn transmittance16(&self, origin: Vec3, targets: &[Vec3; 16], n: usize, out: &mut [Vec3; 16]) {
        let short = shortening(origin, self.extent);
        if short > 0.0 {
            // In place: a mapped array is not kept in registers.
            let mut targets = *targets;
            targets.iter_mut().for_each(|target| *target = nearer(origin, *target, short));
            return self.free16(origin, &targets, n, out);
        }
        self.free16(origin, targets, n, out);
    }

    #[inline]
    fn free16(&self, origin: Vec3, targets: &[Vec3; 16], n: usize, out: &mut [Vec3; 16]) {
        let visible = self.solid.visible16(origin, targets, n, 0.0, SHADOW_END);
        for i in 0..n {
            out[i] = match (visible >> i & 1, &self.sheer) {
                (0, _) => Vec3::ZERO,
                (_, None) => Vec3::ONE,
                _ => self.sheer_transmittance(shadow_ray(origin, targets[i])),
            };
        }
    }

    /// Bit i is set where nothing at all lies between `origin` and target i of up to 16: no pane either, however clear.
    pub(crate) fn sees16(&self, origin: Vec3, targets: &[Vec3; 16], n: usize) -> u16 {
        let (short, mut targets) = (shortening(origin, self.extent), *targets);
        targets.iter_mut().for_each(|target| *target = nearer(origin, *target, short));
        let mut seen = self.solid.visible16(origin, &targets, n, 0.0, SHADOW_END);
        for (i, target) in targets.iter().enumerate().take(n) {
            if seen >> i & 1 == 1 && self.meets_sheer(shadow_ray(origin, *target)) {
                seen &= !(1 << i);
            }
        }
        seen
    }

    /// The share of light that passes from one point of a lamp to each of up to 16 places, where their rays begin.
    pub(crate) fn transmittance_from16(&self, lamp: Vec3, places: &[Vec3; 16], n: usize, out: &mut [Vec3; 16]) {
        let (begin, end) = (1.0 - SHADOW_END, 1.0);
        let visible = self.solid.visible16(lamp, places, n, begin, end);
        let clear = self.sheer.as_ref().map_or(visible, |sheer| sheer.visible16(lamp, places, n, begin, end));
        for i in 0..n {
            out[i] = match (visible >> i & 1, clear >> i & 1) {
                (0, _) => Vec3::ZERO,
                (_, 1) => Vec3::ONE,
                _ => self.sheer_transmittance(shadow_ray(places[i], lamp)),
            };
        }
    }

    fn sheer_transmittance(&self, mut ray: Ray) -> Vec3 {
        let mut passed = Vec3::ONE;
        let Some(sheer) = &self.sheer else { return passed };
        while let Some(hit) = sheer.closest(&ray) {
            let alpha = self.alpha(hit.triangle, barycentric_of(&hit));
            let through = if alpha > 0.0 && self.is_clear_pane(hit.triangle) {
                self.bsdf(&self.surface_hit(&hit), -ray.direction.normalize()).straight_through()
            } else {
                Vec3::ZERO
            };
            passed *= Vec3::splat(1.0 - alpha) + through * alpha;
            if passed == Vec3::ZERO {
                return passed;
            }
            ray.t_min = next_after(hit.t);
        }
        passed
    }

    /// Whether a clear pane, or a surface with alpha where that is not 0, is on a ray.
    fn meets_sheer(&self, mut ray: Ray) -> bool {
        let Some(sheer) = &self.sheer else { return false };
        while let Some(hit) = sheer.closest(&ray) {
            if self.alpha(hit.triangle, barycentric_of(&hit)) > 0.0 {
                return true;
            }
            ray.t_min = next_after(hit.t);
        }
        false
    }

    /// Probability that a point of a triangle is there.
    fn alpha(&self, triangle: u32, barycentric: Vec3) -> f32 {
        let (uvs, color) = (self.uvs(triangle, barycentric), self.vertex_color(triangle, barycentric));
        bsdf::alpha(self.material(triangle), &self.scene.textures, uvs, color)
    }

    fn surface_hit(&self, hit: &Hit) -> SurfaceHit {
        let [a, b, c] = self.scene.mesh.corners(hit.triangle);
        let (ab, ac) = (b - a, c - a);
        let barycentric = barycentric_of(hit);
        let (position, across) = (a + ab * hit.u + ac * hit.v, ab.cross(ac));
        let normal = across.normalize_or(Vec3::Y);
        let extent = self.extent;
        let clearance = clearance(ab, ac, across) + rounding(position, normal, extent);
        SurfaceHit { triangle: hit.triangle, t: hit.t, position, barycentric, normal, clearance, extent }
    }

    /// Where a ray begins that leaves a point of a triangle to the side of `outward`, a unit vector across the triangle.
    pub(crate) fn off_triangle(&self, triangle: u32, position: Vec3, outward: Vec3) -> Vec3 {
        let [a, b, c] = self.scene.mesh.corners(triangle);
        let (ab, ac) = (b - a, c - a);
        let clear = clearance(ab, ac, ab.cross(ac)) + rounding(position, outward, self.extent);
        offset_origin(position + outward * clear, outward, self.extent)
    }

    /// The point of a triangle with two of its barycentric coordinates.
    pub(crate) fn point_of(&self, triangle: u32, uv: Vec2) -> SurfaceHit {
        self.surface_hit(&Hit { triangle, t: 0.0, u: uv.x, v: uv.y })
    }

    /// The same scene whose walks are sent toward no mirror and no clear body: noisier caustics, and the same mean.
    pub fn without_guides(self) -> PreparedScene {
        PreparedScene { casters: None, ..self }
    }

    /// The same scene where only surfaces without a coat share walks: noisier indirect light, and the same mean.
    pub fn with_lone_coats(self) -> PreparedScene {
        PreparedScene { coats_share: false, ..self }
    }

    /// The same scene whose blocks are judged by both halves of their samples alone: more samples where light is shared, and the
    /// same mean.
    pub fn without_colors(self) -> PreparedScene {
        PreparedScene { colors_judge: false, ..self }
    }

    /// The same scene no node of whose shared light is dimmed for outshining those around it: spots of rare bright walks, and nothing
    /// cut off.
    pub fn without_clamp(self) -> PreparedScene {
        PreparedScene { nodes_are_calmed: false, ..self }
    }

    /// The same scene where the samples of a pixel know nothing of each other: noisier, and the same mean. Walks that go on from one first
    /// vertex are stratified together all the same.
    pub fn with_lone_samples(self) -> PreparedScene {
        PreparedScene { samples_are_stratified: false, ..self }
    }

    /// The same scene where bakes connect the first vertex of a walk to one light, and later ones to one of each group: noisier, and the
    /// same mean. Second vertices that pixels share are connected to all lights all the same.
    pub fn with_lone_connections(self) -> PreparedScene {
        PreparedScene { connects_to_all: false, ..self }
    }

    /// Material of a triangle.
    pub fn material(&self, triangle: u32) -> &Material {
        &self.scene.materials[self.scene.mesh.triangle_material[triangle as usize] as usize]
    }

    /// Whether light goes straight on through a triangle, at least there where its textures leave it smooth: see
    /// [`Material::is_clear_pane`].
    #[inline]
    pub fn is_clear_pane(&self, triangle: u32) -> bool {
        self.clear_panes[self.scene.mesh.triangle_material[triangle as usize] as usize]
    }

    /// Whether no light passes a triangle, whatever its textures say.
    pub(crate) fn is_wall(&self, triangle: u32) -> bool {
        let material = self.material(triangle);
        material.alpha == AlphaMode::Opaque && !material.transmits() && !material.unlit
    }

    /// What of the scene itself is found needless, whoever looks at it.
    pub fn spared(&self) -> Spared {
        let mut spared =
            Spared { idle_images: self.scene.idle_images, idle_bytes: self.scene.idle_bytes, ..Spared::default() };
        if self.skips.has(Skip::Lobes) {
            let diffuse = self.scene.materials.iter().filter(|material| material.is_plainly_diffuse()).count();
            spared.diffuse_materials = diffuse as u32;
            spared.diffuse_share = self.share_of_area(|triangle| self.material(triangle).is_plainly_diffuse());
        }
        if self.skips.has(Skip::Alpha) {
            spared.opaque_triangles = self.solid.n_triangles() as u32;
            spared.opaque_share =
                self.share_of_area(|triangle| is_never_asked(self.material(triangle), self.is_clear_pane(triangle)));
        }
        spared
    }

    /// Share of the area of all surfaces that some triangles have, 0 where there is no area.
    fn share_of_area(&self, is_one: impl Fn(u32) -> bool) -> f32 {
        let mesh = &self.scene.mesh;
        let (mut theirs, mut all) = (0.0, 0.0);
        for triangle in 0..mesh.triangles.len() as u32 {
            let area = f64::from(mesh.area_m2(triangle));
            all += area;
            theirs += if is_one(triangle) { area } else { 0.0 };
        }
        if all > 0.0 { (theirs / all) as f32 } else { 0.0 }
    }

    /// Texture coordinates of both sets at a point of a triangle.
    pub fn uvs(&self, triangle: u32, barycentric: Vec3) -> [Vec2; 2] {
        let mesh = &self.scene.mesh;
        let [a, b, c] = mesh.triangles[triangle as usize].map(|v| v as usize);
        [0, 1].map(|set| match mesh.uvs[set].as_slice() {
            [] => Vec2::ZERO,
            uvs => uvs[a] * barycentric.x + uvs[b] * barycentric.y + uvs[c] * barycentric.z,
        })
    }

    fn vertex_color(&self, triangle: u32, barycentric: Vec3) -> Option<glam::Vec4> {
        let colors = &self.scene.mesh.colors;
        let [a, b, c] = self.scene.mesh.triangles[triangle as usize].map(|v| v as usize);
        // By differences, so that a color that all vertices share stays what it is: a cutoff may lie exactly there.
        let between = |of: glam::Vec4, to: [glam::Vec4; 2], w: Vec3| of + (to[0] - of) * w.y + (to[1] - of) * w.z;
        (!colors.is_empty()).then(|| between(colors[a], [colors[b], colors[c]], barycentric))
    }

    /// Base color of a point, for unlit surfaces and guides.
    pub fn base_color(&self, hit: &SurfaceHit) -> Vec3 {
        let uvs = self.uvs(hit.triangle, hit.barycentric);
        let color = self.vertex_color(hit.triangle, hit.barycentric);
        bsdf::surface_params(self.material(hit.triangle), &self.scene.textures, uvs, color).base_color
    }

    /// Whether a point has a diffuse base, whatever its color: anything but pure metal and pure glass.
    pub(crate) fn has_diffuse_base(&self, hit: &SurfaceHit) -> bool {
        let uvs = self.uvs(hit.triangle, hit.barycentric);
        let params = bsdf::surface_params(self.material(hit.triangle), &self.scene.textures, uvs, None);
        params.metallic < 1.0 && params.transmission < 1.0
    }

    /// Unit normal between the vertices' own, without normal map, on the side from which `direction` comes.
    pub fn smooth_normal(&self, hit: &SurfaceHit, direction: Vec3) -> Vec3 {
        let ns = self.vertex_normal(hit);
        if hit.normal.dot(direction) > 0.0 { -ns } else { ns }
    }

    /// Unit normal between the vertices' own, on the front side.
    fn vertex_normal(&self, hit: &SurfaceHit) -> Vec3 {
        let mesh = &self.scene.mesh;
        let [a, b, c] = mesh.triangles[hit.triangle as usize].map(|v| v as usize);
        let w = hit.barycentric;
        let ns = (mesh.normals[a] * w.x + mesh.normals[b] * w.y + mesh.normals[c] * w.z).normalize_or(hit.normal);
        // A shading normal on the other side of its own triangle would turn the surface inside out.
        if ns.dot(hit.normal) <= 0.0 { hit.normal } else { ns }
    }

    /// [`Bsdf::refracted`] of a point of smooth solid glass.
    pub(crate) fn refracted(&self, hit: &SurfaceHit, wo: Vec3) -> Vec3 {
        let looks = self.appearance(hit);
        Bsdf::refracted(&looks.params, hit.normal, looks.ns, wo)
    }

    /// How a point scatters light towards `wo`.
    pub fn bsdf(&self, hit: &SurfaceHit, wo: Vec3) -> Bsdf {
        self.bsdf_of(hit, &self.appearance(hit), wo)
    }

    /// The same of a point whose appearance is at hand.
    pub(crate) fn bsdf_of(&self, hit: &SurfaceHit, looks: &Appearance, wo: Vec3) -> Bsdf {
        match &looks.finish {
            Some(finish) => Bsdf::finished(&looks.params, finish, hit.normal, looks.ns, wo),
            None if self.skips.has(Skip::Lobes) => Bsdf::new(&looks.params, hit.normal, looks.ns, wo),
            None => Bsdf::layered(&looks.params, hit.normal, looks.ns, wo),
        }
    }

    /// Extinction of what a ray enters that passes a triangle, coming `from_back` or from its front, 1/m. A triangle that bounds no
    /// solid leaves it in what it comes from, of extinction `before`.
    pub(crate) fn extinction_behind(&self, triangle: u32, from_back: bool, before: Vec3) -> Vec3 {
        let material = self.material(triangle);
        if material.thickness <= 0.0 || self.is_clear_pane(triangle) {
            return before;
        }
        if from_back || !material.attenuation_distance.is_finite() {
            return Vec3::ZERO;
        }
        // Nothing is left of a channel that its color lacks, at whatever length.
        (-material.attenuation_color.ln() / material.attenuation_distance).min(Vec3::splat(MOST_EXTINCTION))
    }

    /// What a point is made of, whoever looks at it.
    pub(crate) fn appearance(&self, hit: &SurfaceHit) -> Appearance {
        let (mesh, material) = (&self.scene.mesh, self.material(hit.triangle));
        let [a, b, c] = mesh.triangles[hit.triangle as usize].map(|v| v as usize);
        let w = hit.barycentric;
        let uvs = self.uvs(hit.triangle, w);
        let vertex_normal = self.vertex_normal(hit);
        let (mut ns, mut tangent) = (vertex_normal, Vec4::ZERO);
        if (material.normal_texture.is_some() || material.finish.is_some()) && !mesh.tangents.is_empty() {
            tangent = mesh.tangents[a] * w.x + mesh.tangents[b] * w.y + mesh.tangents[c] * w.z;
            ns = bsdf::shading_normal(material, &self.scene.textures, uvs, ns, tangent);
            if ns.dot(hit.normal) <= 0.0 {
                ns = hit.normal;
            }
        }
        let color = self.vertex_color(hit.triangle, w);
        let params = bsdf::surface_params(material, &self.scene.textures, uvs, color);
        let frame = Frame { vertex_normal, shading_normal: ns, tangent };
        let finish = material.finish.as_ref();
        let finish = finish.map(|finish| bsdf::finish_params(finish, &self.scene.textures, uvs, frame));
        Appearance { params, finish, ns }
    }

    /// Column and white radiance that a surface sends towards `wo`, `None` where it emits nothing that way.
    pub fn emitted(&self, hit: &SurfaceHit, wo: Vec3) -> Option<(u32, Vec3)> {
        let source = self.lighting.triangle_source[hit.triangle as usize];
        if source == Lighting::NONE {
            return None;
        }
        let column = self.lighting.basis.sources[source as usize].columns.start;
        let material = self.material(hit.triangle);
        if !material.double_sided && hit.normal.dot(wo) <= 0.0 && !material.unlit {
            return None;
        }
        let uvs = self.uvs(hit.triangle, hit.barycentric);
        match &self.lighting.emitters[source as usize] {
            Emitter::Surface(surface) => Some((column, self.pattern(material, uvs) * surface.white(material))),
            Emitter::Panel(panel) => {
                Some((column + panel.texel(panel.uv_of(hit.position)), self.pattern(material, uvs)))
            }
            Emitter::Constant => Some((column, self.base_color(hit))),
            _ => None,
        }
    }

    /// What the emissive texture of a material, if any, multiplies its radiance by at a texture coordinate.
    pub fn pattern(&self, material: &Material, uvs: [Vec2; 2]) -> Vec3 {
        material.emissive_texture.map_or(Vec3::ONE, |t| t.fetch(&self.scene.textures, uvs).truncate())
    }

    /// What texture and alpha multiply the radiance of a point of a triangle by that is sampled, whether it is there or not.
    pub(crate) fn shown(&self, triangle: u32, barycentric: Vec3) -> Vec3 {
        self.pattern(self.material(triangle), self.uvs(triangle, barycentric)) * self.alpha(triangle, barycentric)
    }

    /// A distance from anything within to beyond everything, m.
    pub(crate) fn far(&self) -> f32 {
        beyond(self.extent)
    }

    /// Diagonal of all surfaces, m; infinite where there are none.
    pub fn extent(&self) -> f32 {
        self.extent
    }

    /// Length of the diagonal of everything in meters.
    pub fn diameter(&self) -> f32 {
        self.scene.mesh.bounds().map_or(1.0, |(lo, hi)| (hi - lo).length().max(1e-6))
    }
}

/// Whether rays that light goes along meet a surface wherever they come to it, and need not ask for its alpha.
fn is_never_asked(material: &Material, is_clear_pane: bool) -> bool {
    material.alpha == AlphaMode::Opaque && !material.unlit && !is_clear_pane
}

/// A distance from anything within a scene with such a diagonal to beyond everything, m.
pub(crate) fn beyond(extent: f32) -> f32 {
    if extent.is_finite() { 4.0 * extent.max(1e-6) } else { 1.0 }
}

/// Barycentric coordinates of all three vertices.
fn barycentric_of(hit: &Hit) -> Vec3 {
    Vec3::new(1.0 - hit.u - hit.v, hit.u, hit.v)
}

fn diagonal(trees: [Option<&Bvh>; 3]) -> f32 {
    let bounds = trees.into_iter().flatten().map(Bvh::bounds);
    let all = bounds.fold(Aabb::EMPTY, |a, b| Aabb { min: a.min.min(b.min), max: a.max.max(b.max) });
    (all.max - all.min).length()
}

/// Extinction of a solid that lets nothing pass, 1/m: finite, so that no length at all leaves all light.
const MOST_EXTINCTION: f32 = 1e20;

/// Shadow rays end just before the light's own surface.
pub(crate) const SHADOW_END: f32 = 0.9999;

fn shadow_ray(origin: Vec3, target: Vec3) -> Ray {
    Ray { origin, direction: target - origin, t_min: 0.0, t_max: SHADOW_END }
}

/// The least distance along a ray that is beyond a hit.
pub(crate) fn next_after(t: f32) -> f32 {
    (t * (1.0 + 1e-6)).max(t.next_up())
}
