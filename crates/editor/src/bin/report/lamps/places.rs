//! Errors of the indirect light of lamps at their places.

use clerestory_transport::scene::Mesh;
use glam::Vec3;

use crate::errors::{Sum, decibels, quantile};

/// Noise of a reference of the indirect light, beyond which its place says nothing.
const MOST_NOISE: f64 = 0.5;
/// Share of the pixels that count as the worst.
pub const WORST: f64 = 0.005;

/// A lamp's light at one place, and that of the file, nit; those of two are independent of each other.
pub struct Pictures<'a> {
    /// What patches make of the lamp's light.
    pub of_patches: &'a [f32],
    /// What of it is found anew: the direct light, and what narrow lobes show.
    pub live: [&'a [f32]; 2],
    /// The direct light alone.
    pub direct: [&'a [f32]; 2],
    /// The lamp's light as it is traced.
    pub references: [&'a [f32]; 2],
    /// The light of the file as it was baked.
    pub own: &'a [f32],
    /// The same as it is traced.
    pub own_references: [&'a [f32]; 2],
}

/// What was measured at a place whose light does not drown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The number that it was drawn by, from 0 on.
    pub number: u32,
    /// Height above the nearest surface, m.
    pub height_m: f32,
    /// Relative L2 of the indirect light, of all pixels and without the worst; no error is told as less than its standard error.
    pub l2: [f64; 2],
    /// Relative L2 of the noise of the mean of its references.
    pub noise: f64,
    /// Share of the indirect light that is found.
    pub energy: f64,
    /// Share of the error that stands in the worst pixels; `None` where it is less than its standard error.
    pub in_worst: Option<f64>,
    /// PSNR of the whole picture, and of the noise of its references, dB.
    pub psnr_db: [f64; 2],
    /// The same of the lamp's light alone, direct and indirect.
    pub lamp_psnr_db: f64,
}

/// Pixels that count as the worst.
pub fn n_worst(n_pixels: usize) -> usize {
    ((n_pixels as f64 * WORST) as usize).max(1)
}

/// The squared errors of some pixels.
fn summed(squares: &[[f64; 2]]) -> Sum {
    let mut sum = Sum::default();
    squares.iter().for_each(|[off, _]| sum.add(*off));
    sum
}

/// The same in all, as no less than what is known of them.
fn known(squares: &[[f64; 2]]) -> f64 {
    summed(squares).mean_at_least_known() * squares.len() as f64
}

/// Squares, summed over a picture, of the noise of the mean of two references of a lamp's indirect light, and of that light.
fn noise_and_light(references: [&[f32]; 2], direct: [&[f32]; 2]) -> [f64; 2] {
    let of_value = |at: usize| {
        let [a, b] = [0, 1].map(|half| f64::from(references[half][at]) - f64::from(direct[half][at]));
        [0.25 * (a - b).powi(2), a * b]
    };
    (0..references[0].len()).map(of_value).fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d])
}

/// Whether a lamp's indirect light drowns in the noise of its references.
pub fn drowns(references: [&[f32]; 2], direct: [&[f32]; 2]) -> bool {
    let [noise, light] = noise_and_light(references, direct);
    let is_seen = light > 0.0 && noise <= MOST_NOISE * MOST_NOISE * light;
    !is_seen
}

impl Pictures<'_> {
    /// How far off the lamp's light is, in each of two independent ways: patches and live light against a traced picture.
    fn off(&self, at: usize) -> [f64; 2] {
        [0, 1].map(|half| f64::from(self.of_patches[at]) + self.live(half, at) - f64::from(self.references[half][at]))
    }

    fn live(&self, half: usize, at: usize) -> f64 {
        f64::from(self.live[half][at])
    }

    fn direct(&self, half: usize, at: usize) -> f64 {
        f64::from(self.direct[half][at])
    }

    /// Squared errors and squares of the indirect light, pixel by pixel, the worst first.
    fn squares(&self) -> Vec<[f64; 2]> {
        let of_value = |at: usize| {
            let [off_a, off_b] = self.off(at);
            let [a, b] = [0, 1].map(|half| f64::from(self.references[half][at]) - self.direct(half, at));
            [off_a * off_b, a * b]
        };
        let n_pixels = self.of_patches.len() / 3;
        let add = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a + c, b + d];
        let mut squares: Vec<[f64; 2]> =
            (0..n_pixels).map(|pixel| (3 * pixel..3 * pixel + 3).map(of_value).fold([0.0; 2], add)).collect();
        squares.sort_by(|[a, _], [b, _]| b.total_cmp(a));
        squares
    }

    /// Measures a place.
    pub fn place(&self, number: u32, height_m: f32) -> Place {
        let squares = self.squares();
        let (worst, rest) = squares.split_at(n_worst(squares.len()));
        let sum = |squares: &[[f64; 2]], which: usize| squares.iter().map(|square| square[which]).sum::<f64>();
        let (of_worst, of_rest) = (sum(worst, 0), sum(rest, 0));
        let off = of_worst + of_rest;
        let [noise, light] = noise_and_light(self.references, self.direct);
        let [mut found, mut there] = [0.0; 2];
        for at in 0..self.of_patches.len() {
            let [a, b] = [0, 1].map(|half| f64::from(self.references[half][at]) - self.direct(half, at));
            let shown = [0, 1].map(|half| self.live(half, at) - self.direct(half, at));
            found += f64::from(self.of_patches[at]) + 0.5 * (shown[0] + shown[1]);
            there += 0.5 * (a + b);
        }
        let l2 = |off: f64, light: f64| (off / light).sqrt();
        Place {
            number,
            height_m,
            l2: [l2(known(&squares), light), l2(known(rest), sum(rest, 1))],
            noise: l2(noise, light),
            energy: found / there,
            in_worst: (off > 0.0 && !summed(&squares).is_noise()).then(|| of_worst / off),
            psnr_db: self.psnr_db(),
            lamp_psnr_db: self.lamp_psnr_db(),
        }
    }

    fn lamp_psnr_db(&self) -> f64 {
        let n = self.of_patches.len();
        let squares = Sum::of_pixels(n, |at| {
            let [a, b] = self.off(at);
            a * b
        });
        let both = |at: usize| 0.5 * [0, 1].map(|half| f64::from(self.references[half][at])).iter().sum::<f64>();
        decibels(quantile((0..n).map(both).collect()), squares.mean_at_least_known())
    }

    fn psnr_db(&self) -> [f64; 2] {
        let n = self.own.len();
        let file = |half: usize, at: usize| f64::from(self.own_references[half][at]);
        let whole = |half: usize, at: usize| f64::from(self.references[half][at]) + file(half, at);
        let squares = Sum::of_pixels(n, |at| {
            let off = self.off(at);
            let [a, b] = [0, 1].map(|half| off[half] + f64::from(self.own[at]) - file(half, at));
            a * b
        });
        let noise = Sum::of_pixels(n, |at| 0.25 * (whole(0, at) - whole(1, at)).powi(2));
        let peak = quantile((0..n).map(|at| 0.5 * (whole(0, at) + whole(1, at))).collect());
        [squares.mean_at_least_known(), noise.mean()].map(|square| decibels(peak, square))
    }
}

/// Distance to the nearest surface, m.
pub fn height_m(mesh: &Mesh, place: Vec3) -> f32 {
    let distances = (0..mesh.triangles.len() as u32).map(|triangle| distance_m(mesh.corners(triangle), place));
    distances.fold(f32::INFINITY, f32::min)
}

/// Distance to a triangle.
fn distance_m([a, b, c]: [Vec3; 3], place: Vec3) -> f32 {
    let edges = [(a, b), (b, c), (c, a)];
    let normal = (b - a).cross(c - a);
    let is_above = |(from, to): &(Vec3, Vec3)| (*to - *from).cross(place - *from).dot(normal) >= 0.0;
    if normal.length_squared() > 0.0 && edges.iter().all(is_above) {
        return (place - a).dot(normal.normalize()).abs();
    }
    let to_edge = |(from, to): (Vec3, Vec3)| {
        let along = to - from;
        let share = (place - from).dot(along) / along.length_squared().max(f32::MIN_POSITIVE);
        place.distance(from + along * share.clamp(0.0, 1.0))
    };
    edges.into_iter().map(to_edge).fold(f32::INFINITY, f32::min)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_is_as_near_as_its_face_its_edge_or_its_corner() {
        let triangle = [Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0];
        let near = |x: f32, y: f32, z: f32| distance_m(triangle, Vec3::new(x, y, z));
        assert_eq!([near(1.0, 1.0, -3.0), near(2.0, -1.0, 0.0), near(-3.0, 0.0, 4.0)], [3.0, 1.0, 5.0]);
        assert_eq!(distance_m([Vec3::ZERO; 3], Vec3::X), 1.0);
    }

    /// A picture of one pixel after the other, each gray.
    fn gray(values: &[f32]) -> Vec<f32> {
        values.iter().flat_map(|value| [*value; 3]).collect()
    }

    #[test]
    fn noise_of_what_is_held_against_each_other_is_no_error() {
        // Live light, direct light and references scatter, each by itself; the patches are right.
        let dark = gray(&[0.0; 4]);
        let patches = gray(&[1.0; 4]);
        let live = [gray(&[0.5, -0.5, 0.0, 0.0]), gray(&[0.0, 0.0, 0.25, -0.25])];
        let references = [gray(&[1.0, 1.0, 1.25, 0.75]), gray(&[1.0, 1.0, 1.0, 1.0])];
        let pictures = Pictures {
            of_patches: &patches,
            live: [&live[0], &live[1]],
            direct: [&dark, &dark],
            references: [&references[0], &references[1]],
            own: &dark,
            own_references: [&dark, &dark],
        };
        let place = pictures.place(3, 0.5);
        // Of the third and the fourth pixel: −0.25 · 0.25 in both halves, in the mean less than nothing, known to half of it.
        assert!((place.l2[0] - 0.125).abs() < 1e-9 && (place.l2[1] - 0.1304).abs() < 1e-4, "{place:?}");
        assert!((place.lamp_psnr_db - decibels(1.125, 0.125 * 0.125)).abs() < 1e-9, "{place:?}");
        assert_eq!((place.energy, place.in_worst, place.number, place.height_m), (1.0, None, 3, 0.5));
        assert!((place.noise - (0.25f64 * 2.0 * 0.25 * 0.25 / 4.0).sqrt()).abs() < 1e-9, "{place:?}");
        // Patches that are dark lack all of it, wherever noise is.
        let place = Pictures { of_patches: &dark, live: [&dark, &dark], ..pictures }.place(3, 0.5);
        assert!((place.l2[0] - 1.0).abs() < 1e-9, "{place:?}");
        assert_eq!(place.energy, 0.0);
    }

    #[test]
    fn no_pixels_share_an_error_that_is_less_than_its_standard_error() {
        let (dark, ones) = (gray(&[0.0; 4]), gray(&[1.0; 4]));
        // Of the products 1, −1, 1 and −0.5 the mean is an eighth, its standard error more than three times that.
        let live = [gray(&[1.0; 4]), gray(&[1.0, -1.0, 1.0, -0.5])];
        let pictures = Pictures {
            of_patches: &ones,
            live: [&live[0], &live[1]],
            direct: [&dark, &dark],
            references: [&ones, &ones],
            own: &dark,
            own_references: [&dark, &dark],
        };
        assert_eq!(pictures.place(0, 1.0).in_worst, None);
        let known = Pictures { live: [&live[0], &live[0]], ..pictures };
        assert_eq!(known.place(0, 1.0).in_worst, Some(0.25));
    }

    #[test]
    fn the_worst_pixels_are_told_apart() {
        let (dark, ones) = (gray(&[0.0; 400]), gray(&[1.0; 400]));
        let mut live = vec![0.1; 400];
        (live[7], live[300]) = (10.0, 8.0);
        let live = gray(&live);
        let place = Pictures {
            of_patches: &ones,
            live: [&live, &live],
            direct: [&dark, &dark],
            references: [&ones, &ones],
            own: &dark,
            own_references: [&dark, &dark],
        }
        .place(0, 1.0);
        assert_eq!(n_worst(400), 2);
        let (worst, rest) = (164.0, 398.0 * 0.01);
        let [l2, without] = place.l2;
        assert!((l2 - ((worst + rest) / 400.0f64).sqrt()).abs() < 1e-6, "{l2}");
        assert!((without - 0.1).abs() < 1e-6, "{without}");
        assert!((place.in_worst.unwrap() - worst / (worst + rest)).abs() < 1e-6, "{place:?}");
        // The file is dark, so that its picture is that of the lamp.
        assert!((place.lamp_psnr_db - decibels(1.0, (worst + rest) / 400.0)).abs() < 1e-4, "{place:?}");
        assert_eq!(place.lamp_psnr_db, place.psnr_db[0]);
    }

    #[test]
    fn light_drowns_where_two_references_of_it_agree_too_little() {
        let (dark, light) = (gray(&[0.0; 2]), gray(&[1.0; 2]));
        let drown = |a: [f32; 2], b: [f32; 2]| drowns([&gray(&a), &gray(&b)], [&dark, &dark]);
        assert!(!drown([1.5, 0.75], [0.75, 1.5]));
        assert!(drown([1.75, 0.5], [0.5, 1.75]));
        assert!(drown([3.0, -1.0], [-1.0, 3.0]), "they agree less than not at all");
        assert!(drowns([&light, &light], [&light, &light]), "all of it is direct");
    }
}
