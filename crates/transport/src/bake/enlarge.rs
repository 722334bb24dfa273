//! A small picture of a bake as one of many pixels: each pixel is told by those around it that show the same surface.
//!
//! Light changes slowly over a surface, what is seen of the surface does not. A pixel takes the light of those of the small picture whose
//! surface faces the same way in one plane, per color of the surface, and gives it its own color: edges and textures are as sharp as the large
//! picture has them, shadows and mirrored things as the small one has them \[Kopf2007\]. Lights themselves are told by nobody: what is seen of
//! them is known, and kept apart from what surfaces reflect, as sparse entries.

use std::ops::Range;

use clerestory_nystrom::{BlockLowRank, Likeness, Partition, Teller, Tellers, enlarged};
use glam::Vec2;
use rayon::prelude::*;

use super::focus::Focus;
use super::{BakeHeader, BakeJob, LAMPS_APART_BYTES};
use crate::camera::Film;
use crate::guides::{Guides, LightSeen, beside};
use crate::matrix::CHANNELS;

/// How far pixels of the small picture tell, in these: weights fall to none there, across and down.
const REACH: f32 = 1.5;
/// Share of the weight around a pixel that those alike have at least: else the small picture has not met its surface, and all tell that see
/// a surface as well.
const LEAST_ALIKE: f32 = 0.05;
/// Where a pixel is looked at in which surfaces or colors change: four places, no two in one row or column.
const WITHIN: [[f32; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];
/// They change where a pixel beside is less alike than that, or its color is off by more than that share of both.
const ALIKE: f32 = 0.5;
const SAME_COLOR: f32 = 0.05;
/// Memory of a look at a pixel, bytes, about, while all are made.
const LOOK_BYTES: usize = 200;

impl BakeJob {
    /// The matrices of this bake, whose pixels are seen at their centers ([`Passes::FirstLook`](super::Passes::FirstLook)), as those of a picture
    /// of more pixels of the same view; `None` where they would take more memory than a preview may, or nobody wants them any more.
    pub fn enlarged(
        &self,
        header: &BakeHeader,
        groups: &[BlockLowRank],
        to: Film,
        focus: &Focus,
    ) -> Option<Vec<BlockLowRank>> {
        let n_bytes: usize = groups.iter().map(BlockLowRank::n_bytes).sum();
        // In a preview what the halves differ by, which is not known here, takes as much again.
        let n_times = 2 * to.n_pixels().div_ceil(self.film.n_pixels());
        if n_bytes.saturating_mul(n_times) > LAMPS_APART_BYTES {
            return None;
        }
        if to.n_pixels().saturating_mul(LOOK_BYTES) > LAMPS_APART_BYTES {
            return None;
        }
        let goes_on = || !focus.is_left();
        let partition = Partition { width: to.width, height: to.height, tile: self.config.block };
        enlarged(groups, &partition, &Showing::new(self, header, to, &goes_on)?, &goes_on)
    }
}

/// What pixels of both pictures show.
struct Showing<'a> {
    header: &'a BakeHeader,
    /// Sizes of the small picture and of the large one.
    films: [Film; 2],
    /// How far the middle of the picture lies to the right of the camera's axis, in widths of it.
    shift: f32,
    small: Guides,
    large: Guides,
    /// More looks at pixels of the large one in which something changes, as many at each as there are places [`WITHIN`] it.
    fine: Guides,
    /// Where the looks at a pixel begin among these.
    first_fine: Vec<Option<u32>>,
}

impl<'a> Showing<'a> {
    /// `None` if `goes_on` said no.
    fn new(
        job: &BakeJob,
        header: &'a BakeHeader,
        to: Film,
        goes_on: &(dyn Fn() -> bool + Sync),
    ) -> Option<Showing<'a>> {
        let look = |film: Film| Guides::at_centers(&job.scene, &job.camera, film, goes_on);
        let (small, large) = (look(job.film)?, look(to)?);
        let changing: Vec<bool> = (0..to.n_pixels()).into_par_iter().map(|pixel| changes(&large, to, pixel)).collect();
        let n_fine = WITHIN.len() * changing.iter().filter(|changes| **changes).count();
        let is_looked_at = |pixel: usize| changing[pixel] && n_fine.saturating_mul(LOOK_BYTES) <= LAMPS_APART_BYTES;
        let (mut points, mut first_fine) = (Vec::new(), vec![None; to.n_pixels()]);
        for (pixel, first) in first_fine.iter_mut().enumerate().filter(|(pixel, _)| is_looked_at(*pixel)) {
            *first = Some(points.len() as u32);
            let corner = Vec2::new((pixel % to.width as usize) as f32, (pixel / to.width as usize) as f32);
            points.extend(WITHIN.map(|within| (pixel as u32, corner + Vec2::from(within))));
        }
        let fine = large.at_points((&job.scene, &job.camera), to, &points, goes_on)?;
        Some(Showing { header, films: [job.film, to], shift: job.camera.shift[0], small, large, fine, first_fine })
    }

    /// The looks at a pixel of the large picture.
    fn looks(&self, pixel: u32) -> (&Guides, Range<u32>) {
        match self.first_fine[pixel as usize] {
            Some(first) => (&self.fine, first..first + WITHIN.len() as u32),
            None => (&self.large, pixel..pixel + 1),
        }
    }

    /// Pixels of the small picture within reach of one of the large one, with the weight of their distance. Both have the same angle of view
    /// from top to bottom; from side to side it follows their shapes, which are not quite the same.
    fn around(&self, pixel: u32) -> impl Iterator<Item = (u32, f32)> {
        let [small, large] = self.films;
        let size = |film: Film| Vec2::new(film.width as f32, film.height as f32);
        let own = Vec2::new((pixel % large.width) as f32, (pixel / large.width) as f32);
        let mut share = (own + 0.5) / size(large);
        let wider = (large.width as f32 * small.height as f32) / (small.width as f32 * large.height as f32);
        share.x = (share.x - 0.5 + self.shift) * wider + 0.5 - self.shift;
        let center = (share * size(small) - 0.5).clamp(Vec2::ZERO, size(small) - 1.0);
        let within = move |at: f32, end: u32| {
            let (first, last) = ((at - REACH).ceil().max(0.0) as u32, ((at + REACH) as u32).min(end - 1));
            (first..=last).map(move |px| (px, REACH - (px as f32 - at).abs())).filter(|(_, weight)| *weight > 0.0)
        };
        within(center.y, small.height).flat_map(move |(y, of_row)| {
            within(center.x, small.width).map(move |(x, weight)| (y * small.width + x, weight * of_row))
        })
    }

    /// What tells a look at a pixel, which counts as so much of it.
    fn tell_look(&self, (guides, look): (&Guides, u32), (pixel, part): (u32, f32), out: &mut Vec<Teller<CHANNELS>>) {
        let (light, is_void) = (guides.light(look), guides.is_void(look));
        let is_unlit = |light: Option<LightSeen>| light.is_some_and(|light| light.is_unlit);
        if is_unlit(light) {
            return;
        }
        let tells = |other: u32| self.small.is_void(other) == is_void && !is_unlit(self.small.light(other));
        let weighed: Vec<(u32, f32, f32)> = self
            .around(pixel)
            .filter(|(other, _)| tells(*other))
            .map(|(other, weight)| (other, weight, weight * guides.likeness_to(look, &self.small, other)))
            .collect();
        let [all, alike] =
            weighed.iter().fold([0.0; 2], |[all, alike], (_, weight, like)| [all + weight, alike + like]);
        let is_met = alike > LEAST_ALIKE * all;
        let share = |(other, weight, like): &(u32, f32, f32)| (*other, if is_met { *like } else { *weight });
        let mut gains = [0.0f32; CHANNELS];
        for (other, share) in weighed.iter().map(share) {
            gains.iter_mut().zip(self.small.gains(other)).for_each(|(sum, gain)| *sum += share * gain);
        }
        // Light that is seen by mirrors is told by those that see the same, or none; light that is seen straight by nobody.
        let column = |light: Option<LightSeen>| light.map(|light| light.column);
        let is_straight = |light: Option<LightSeen>| light.is_some_and(|light| light.is_straight);
        let shows_same =
            |other: Option<LightSeen>| !is_straight(light) && !is_straight(other) && column(other) == column(light);
        let own = guides.gains(look);
        for (other, share) in weighed.iter().map(share).filter(|(_, share)| *share > 0.0) {
            let factors: [f32; CHANNELS] = std::array::from_fn(|c| part * share * own[c] / gains[c]);
            let sparse = if shows_same(self.small.light(other)) { factors } else { [0.0; CHANNELS] };
            match out.iter_mut().find(|known| known.bundle == other) {
                Some(known) => {
                    known.factors.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += factor);
                    known.sparse.iter_mut().zip(sparse).for_each(|(sum, factor)| *sum += factor);
                }
                None => out.push(Teller { bundle: other, factors, sparse }),
            }
        }
    }
}

/// Whether a pixel lies where surfaces, colors or lights change.
fn changes(guides: &Guides, film: Film, pixel: usize) -> bool {
    let own = pixel as u32;
    let column = |pixel: u32| guides.light(pixel).map(|light| light.column);
    beside(film, pixel).map(|other| other as u32).any(|other| {
        let mut colors = guides.gains(own).iter().zip(guides.gains(other));
        guides.is_void(own) != guides.is_void(other)
            || column(own) != column(other)
            || guides.likeness_to(own, guides, other) < ALIKE
            || colors.any(|(a, b)| (a - b).abs() > SAME_COLOR * (a + b))
    })
}

impl Tellers<CHANNELS> for Showing<'_> {
    fn tell(&self, pixel: u32, out: &mut Vec<Teller<CHANNELS>>) {
        let (guides, looks) = self.looks(pixel);
        let part = 1.0 / looks.len() as f32;
        looks.for_each(|look| self.tell_look((guides, look), (pixel, part), out));
    }

    fn own(&self, pixel: u32, group: usize, out: &mut Vec<(u32, [f32; CHANNELS])>) {
        let (guides, looks) = self.looks(pixel);
        let (columns, part) = (&self.header.basis.groups[group].columns, 1.0 / looks.len() as f32);
        let lights = looks.filter_map(|look| guides.light(look));
        for light in lights.filter(|light| light.is_straight && columns.contains(&light.column)) {
            let scale = part * self.header.column_scale[light.column as usize];
            out.push((light.column - columns.start, (light.radiance * scale).to_array()));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;
    use std::sync::Arc;

    use glam::Vec3;

    use super::*;
    use crate::bake::{Bake, BakeConfig, Passes};
    use crate::camera::Camera;
    use crate::emitters::SkyRequest;
    use crate::import;
    use crate::laws::stage::{Stage, lambert, quad, room};
    use crate::prepared::PreparedScene;
    use crate::sky::{Environment, SkyForm, SkyLight};

    fn job(film: Film, spp: u32, passes: Passes) -> BakeJob {
        let bytes = include_bytes!("../../../editor/tests/room.gltf");
        let scene = Arc::new(PreparedScene::new(import::load_bytes("room.gltf", bytes).unwrap().scene, &[]).unwrap().0);
        let (camera, irradiance) = (scene.scene.cameras[0].clone(), Vec::new());
        let config = BakeConfig { spp, tolerance_db: 60.0, ..BakeConfig::default() };
        BakeJob { scene, camera, film, config, passes, irradiance }
    }

    fn baked(job: &BakeJob) -> Bake {
        job.clone().run(|_| ControlFlow::Continue(())).unwrap().unwrap()
    }

    /// The picture under the light of the file.
    fn picture(bake: &Bake, groups: &[BlockLowRank]) -> Vec<f32> {
        let light = bake.header.basis.file_light(&bake.header.column_scale);
        let parts = groups.iter().zip(&bake.header.basis.groups);
        let parts = parts.map(|(group, of)| group.apply(&light[of.columns.start as usize..of.columns.end as usize]));
        parts.reduce(|sum, part| sum.iter().zip(&part).map(|(a, b)| a + b).collect()).unwrap()
    }

    fn square(a: &[f32], b: impl Fn(usize) -> f32) -> f64 {
        a.iter().enumerate().map(|(nth, a)| f64::from(a - b(nth)).powi(2)).sum()
    }

    #[test]
    fn a_small_picture_tells_a_large_one() {
        let (small, large) = (Film { width: 48, height: 36 }, Film { width: 96, height: 72 });
        let (few, many) = (job(small, 64, Passes::FirstLook), job(large, 64, Passes::FinalOnly));
        let [of_few, of_many] = [&few, &many].map(baked);
        let groups = few.enlarged(&of_few.header, &of_few.groups, large, &Focus::default()).unwrap();
        assert_eq!(groups[0].partition, of_many.groups[0].partition);
        let (got, want) = (picture(&of_few, &groups), picture(&of_many, &of_many.groups));
        // Pixels of the small picture as squares of the large one, for comparison.
        let plain = picture(&of_few, &of_few.groups);
        let square_of = |nth: usize| {
            let (x, y) = (nth / CHANNELS % 96 / 2, nth / CHANNELS / 96 / 2);
            plain[(y * 48 + x) * CHANNELS + nth % CHANNELS]
        };
        let [all, off, off_squares] = [square(&want, |_| 0.0), square(&want, |nth| got[nth]), square(&want, square_of)];
        assert!(off < 0.6 * off_squares && off < 2e-3 * all, "{off} {off_squares} of {all}");
    }

    #[test]
    fn lights_are_told_by_nobody_and_tell_nobody() {
        let camera = Camera::look_at("eye", Vec3::new(0.3, -0.2, 0.8), Vec3::new(-0.4, 0.6, -1.0), 1.1, 4.0 / 3.0);
        let scene = Stage::new(camera.clone())
            .surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0))
            .panel("panel", &quad(Vec3::new(-0.5, 0.95, -0.5), Vec3::X, Vec3::Z), 1.0, 4)
            .prepared();
        let (film, to) = (Film { width: 32, height: 24 }, Film { width: 96, height: 72 });
        let config = BakeConfig { spp: 16, tolerance_db: 60.0, ..BakeConfig::default() };
        let (scene, passes, irradiance) = (Arc::new(scene), Passes::FirstLook, Vec::new());
        let job = BakeJob { scene, camera, film, config, passes, irradiance };
        let Bake { header, groups, .. } = baked(&job);
        let large = job.enlarged(&header, &groups, to, &Focus::default()).unwrap().swap_remove(0);
        let showing = Showing::new(&job, &header, to, &|| true).unwrap();
        let n_cols = large.n_cols as usize;
        let mut n_shining = 0;
        for pixel in (0..to.n_pixels() as u32).filter(|pixel| showing.first_fine[*pixel as usize].is_none()) {
            let (block, within) = large.partition.place(pixel).unwrap();
            let mut row = vec![0.0; n_cols];
            large.blocks[block].as_ref().unwrap().row(CHANNELS * within as usize, &mut row);
            if let Some(light) = showing.large.light(pixel) {
                n_shining += 1;
                // The panel is black: it shines, and reflects nothing.
                let column = light.column as usize;
                assert_eq!(row[column], light.radiance.x * header.column_scale[column], "{pixel}");
                row[column] = 0.0;
                assert_eq!(row, vec![0.0; n_cols], "{pixel}");
            }
            assert!(row.iter().all(|entry| *entry < 3.0), "{pixel}: {row:?}");
        }
        assert!(n_shining > 40, "{n_shining}");
    }

    #[test]
    fn a_sky_is_seen_beyond_all_surfaces() {
        let camera = Camera::look_at("eye", Vec3::new(0.0, 1.0, 4.0), Vec3::new(0.0, 0.5, 0.0), 1.1, 4.0 / 3.0);
        let ground = quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
        let light = SkyLight::new("even", Environment::from_fn(8, 4, |_| Vec3::ONE));
        let sky = SkyRequest { light, form: SkyForm::Patches(1) };
        let scene = Stage::new(camera.clone()).surface("ground", &ground, lambert(0.5, 0.0)).prepared_under(&sky);
        let (film, to) = (Film { width: 32, height: 24 }, Film { width: 64, height: 48 });
        let config = BakeConfig { spp: 16, tolerance_db: 60.0, ..BakeConfig::default() };
        let (scene, passes, irradiance) = (Arc::new(scene), Passes::FirstLook, Vec::new());
        let job = BakeJob { scene, camera, film, config, passes, irradiance };
        let small = baked(&job);
        let groups = job.enlarged(&small.header, &small.groups, to, &Focus::default()).unwrap();
        let n_lit = |groups: &[BlockLowRank]| {
            let ones = |group: &BlockLowRank| group.apply(&vec![1.0; group.n_cols as usize]);
            groups.iter().flat_map(ones).filter(|value| *value > 0.0).count()
        };
        let (n_small, n_large) = (n_lit(&small.groups), n_lit(&groups));
        assert!(n_small > 0 && n_large.abs_diff(4 * n_small) < n_small / 2, "{n_small} {n_large}");
    }

    #[test]
    fn nobody_who_has_left_waits_and_nothing_takes_more_memory_than_a_preview() {
        let job = job(Film { width: 16, height: 12 }, 2, Passes::FirstLook);
        let bake = baked(&job);
        let huge = Film { width: 1 << 14, height: 1 << 14 };
        assert!(job.enlarged(&bake.header, &bake.groups, huge, &Focus::default()).is_none());
        let focus = Focus::default();
        focus.leave();
        assert!(job.enlarged(&bake.header, &bake.groups, Film { width: 32, height: 24 }, &focus).is_none());
    }

    #[test]
    fn pixels_tell_that_are_near() {
        let bake = job(Film { width: 16, height: 12 }, 2, Passes::FirstLook);
        let header = baked(&bake).header;
        let to = Film { width: 48, height: 36 };
        let showing = Showing::new(&bake, &header, to, &|| true).unwrap();
        for pixel in 0..to.n_pixels() as u32 {
            let near: Vec<(u32, f32)> = showing.around(pixel).collect();
            assert!((4..=9).contains(&near.len()), "{pixel}: {near:?}");
            let own = pixel / 48 / 3 * 16 + pixel % 48 / 3;
            let most = near.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap().0;
            assert_eq!(most, own, "{pixel}: {near:?}");
        }
    }
}
