//! A matrix of many columns that needs no tracing: a floor and a wall under a panel of texels, three balls between, direct
//! light alone.

use crate::methods::dense::{CHANNELS, Picture};

/// Half of the panel's side and its height above the floor, in meters.
const PANEL: [f32; 2] = [0.6, 2.6];
/// Center and radius.
type Ball = ([f32; 3], f32);
const BALLS: [Ball; 3] = [([-0.5, 0.35, 0.3], 0.35), ([0.45, 0.6, -0.2], 0.25), ([0.1, 0.2, 0.8], 0.2)];
const ALBEDOS: [[f32; CHANNELS]; 2] = [[0.6, 0.55, 0.5], [0.3, 0.5, 0.7]];

/// Width × height pixels, `side` × `side` texels.
pub fn picture(width: usize, height: usize, side: usize) -> Picture {
    lit(width, height, side, &BALLS)
}

/// The same without the balls, so that nothing throws a shadow.
pub fn unshadowed(width: usize, height: usize, side: usize) -> Picture {
    lit(width, height, side, &[])
}

fn lit(width: usize, height: usize, side: usize, balls: &[Ball]) -> Picture {
    let n_cols = side * side;
    let mut values = vec![0.0; width * height * CHANNELS * n_cols];
    for (pixel, rows) in values.chunks_exact_mut(CHANNELS * n_cols).enumerate() {
        let [x, y] = [pixel % width, pixel / width].map(|at| at as f32 + 0.5);
        let (point, normal, albedo) = surface(2.0 * x / width as f32 - 1.0, 1.0 - 2.0 * y / height as f32);
        for texel in 0..n_cols {
            let across = |at: usize| PANEL[0] * (2.0 * (at as f32 + 0.5) / side as f32 - 1.0);
            let light = arriving(point, normal, [across(texel % side), PANEL[1], across(texel / side)], balls);
            (0..CHANNELS).for_each(|channel| rows[channel * n_cols + texel] = albedo[channel] * light);
        }
    }
    Picture { width, height, n_cols, values }
}

/// What a pixel sees: the back wall above, the floor below, in squares of two colors.
fn surface(x: f32, y: f32) -> ([f32; 3], [f32; 3], [f32; CHANNELS]) {
    let (point, normal) =
        if y > 0.0 { ([x, 2.4 * y, -1.0], [0.0, 0.0, 1.0]) } else { ([x, 0.0, -1.0 - 2.0 * y], [0.0, 1.0, 0.0]) };
    let square = point.map(|at| (4.0 * at + 0.01).floor() as i32).iter().sum::<i32>();
    (point, normal, ALBEDOS[square.rem_euclid(2) as usize])
}

/// Irradiance of a point by one texel that balls may hide, but for a factor.
fn arriving(point: [f32; 3], normal: [f32; 3], texel: [f32; 3], balls: &[Ball]) -> f32 {
    let way = minus(texel, point);
    let squared = dot(way, way);
    let (out, off) = (dot(way, normal), way[1]);
    if out <= 0.0 || off <= 0.0 || balls.iter().any(|&(center, radius)| hides(minus(center, point), radius, way)) {
        return 0.0;
    }
    out * off / (squared * squared)
}

/// Whether a ball around `center` meets the way from the origin.
fn hides(center: [f32; 3], radius: f32, way: [f32; 3]) -> bool {
    let along = (dot(center, way) / dot(way, way)).clamp(0.0, 1.0);
    let nearest = minus(center, way.map(|x| along * x));
    dot(nearest, nearest) < radius * radius
}

fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_falls_with_distance_and_balls_throw_shadows() {
        let up = [0.0, 1.0, 0.0];
        let below = arriving([0.9, 0.0, 0.0], up, [0.9, 2.0, 0.0], &BALLS);
        assert!((below - 0.25).abs() < 1e-6 && arriving([0.9, 1.0, 0.0], up, [0.9, 2.0, 0.0], &BALLS) > 3.9 * below);
        let hidden = ([-0.5, 0.0, 0.3], up, [-0.5, 2.6, 0.3]);
        assert_eq!(arriving(hidden.0, hidden.1, hidden.2, &BALLS), 0.0);
        assert!(arriving(hidden.0, hidden.1, hidden.2, &[]) > 0.0);
    }
}
