//! A small picture of a bake as one of many pixels: each pixel is told by those around it that show the same surface.
//!
//! Light changes slowly over a surface, what is seen of the surface does not. A pixel takes the light of those of the small picture whose
//! surface faces the same way in one plane, per color of the surface, and gives it its own color: edges and textures are as sharp as the large
//! picture has them, shadows and mirrored things as the small one has them \[Kopf2007\]. Lights themselves are told by nobody: what is seen of
//! them is known.

use std::ops::Range;

use clerestory_nystrom::{BlockLowRank, Likeness, Partition, Tellers, enlarged};
use glam::Vec2;
use rayon::prelude::*;

use super::focus::Focus;
use super::{BakeHeader, BakeJob, LAMPS_APART_BYTES};
use crate::camera::Film;
use crate::guides::{Guides, LightSeen, beside};
use crate::matrix::CHANNELS;

/// How far pixels of the small picture tell, in these: weights fall to none there, across and down.
const REACH: f32 = 1.5;
/// Share of the weight around a pixel that those alike have at least: else the small picture has not met its surface, and all tell.
const LEAST_ALIKE: f32 = 0.05;
/// Where a pixel is looked at in which surfaces or colors change: four places, no two in one row or column.
const WITHIN: [[f32; 2]; 4] = [[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]];
/// They change where a pixel beside is less alike than that, or its color is off by more than that share of both.
const ALIKE: f32 = 0.5;
const SAME_COLOR: f32 = 0.05;

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
        let (mut points, mut first_fine) = (Vec::new(), vec![None; to.n_pixels()]);
        for (pixel, first) in first_fine.iter_mut().enumerate().filter(|(pixel, _)| changing[*pixel]) {
            *first = Some(points.len() as u32);
            let corner = Vec2::new((pixel % to.width as usize) as f32, (pixel / to.width as usize) as f32);
            points.extend(WITHIN.map(|within| (pixel as u32, corner + Vec2::from(within))));
        }
        let fine = large.at_points((&job.scene, &job.camera), to, &points, goes_on)?;
        Some(Showing { header, films: [job.film, to], small, large, fine, first_fine })
    }

    /// The looks at a pixel of the large picture.
    fn looks(&self, pixel: u32) -> (&Guides, Range<u32>) {
        match self.first_fine[pixel as usize] {
            Some(first) => (&self.fine, first..first + WITHIN.len() as u32),
            None => (&self.large, pixel..pixel + 1),
        }
    }

    /// The light that a look sees, if it outshines what lights light: a column of 1 is as bright as the brightest of that.
    fn glare(&self, guides: &Guides, look: u32) -> Option<LightSeen> {
        let outshines =
            |light: &LightSeen| light.radiance.max_element() * self.header.column_scale[light.column as usize] > 1.0;
        guides.light(look).filter(outshines)
    }

    /// Pixels of the small picture within reach of one of the large one that show something, with the weight of their distance.
    fn around(&self, pixel: u32) -> impl Iterator<Item = (u32, f32)> {
        let [small, large] = self.films;
        let size = |film: Film| Vec2::new(film.width as f32, film.height as f32);
        let own = Vec2::new((pixel % large.width) as f32, (pixel / large.width) as f32);
        let center = (own + 0.5) * size(small) / size(large) - 0.5;
        let within = move |at: f32, end: u32| {
            let (first, last) = ((at - REACH).ceil().max(0.0) as u32, ((at + REACH) as u32).min(end - 1));
            (first..=last).map(move |px| (px, REACH - (px as f32 - at).abs())).filter(|(_, weight)| *weight > 0.0)
        };
        within(center.y, small.height).flat_map(move |(y, of_row)| {
            within(center.x, small.width).map(move |(x, weight)| (y * small.width + x, weight * of_row))
        })
    }

    /// What tells a look at a pixel, which counts as so much of it.
    fn tell_look(
        &self,
        (guides, look): (&Guides, u32),
        (pixel, part): (u32, f32),
        out: &mut Vec<(u32, [f32; CHANNELS])>,
    ) {
        let glare = self.glare(guides, look);
        if guides.is_void(look) || glare.is_some_and(|light| light.is_straight) {
            return;
        }
        let around = || self.around(pixel).filter(|(other, _)| !self.small.is_void(*other));
        let shows =
            |other: u32, column: Option<u32>| self.glare(&self.small, other).map(|light| light.column) == column;
        // What shows another light, or none, says nothing of this one; where nobody around shows it, it is left out.
        let column = glare.map(|light| light.column).filter(|column| around().any(|(at, _)| shows(at, Some(*column))));
        let weighed: Vec<(u32, f32, f32)> = around()
            .filter(|(other, _)| shows(*other, column))
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
        let own = guides.gains(look);
        for (other, share) in weighed.iter().map(share).filter(|(_, share)| *share > 0.0) {
            let factors: [f32; CHANNELS] = std::array::from_fn(|c| part * share * own[c] / gains[c]);
            match out.iter_mut().find(|(known, _)| *known == other) {
                Some((_, sum)) => sum.iter_mut().zip(factors).for_each(|(sum, factor)| *sum += factor),
                None => out.push((other, factors)),
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
    fn tell(&self, pixel: u32, out: &mut Vec<(u32, [f32; CHANNELS])>) {
        let (guides, looks) = self.looks(pixel);
        let part = 1.0 / looks.len() as f32;
        looks.for_each(|look| self.tell_look((guides, look), (pixel, part), out));
    }

    fn own(&self, pixel: u32, group: usize, out: &mut Vec<(u32, [f32; CHANNELS])>) {
        let (guides, looks) = self.looks(pixel);
        let (columns, part) = (&self.header.basis.groups[group].columns, 1.0 / looks.len() as f32);
        let lights = looks.filter_map(|look| self.glare(guides, look));
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

    use super::*;
    use crate::bake::{Bake, BakeConfig, Passes};
    use crate::import;
    use crate::prepared::PreparedScene;

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
