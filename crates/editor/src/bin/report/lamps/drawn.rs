//! Places of lamps whose light can be told from the noise of its references; others are drawn anew.

use anyhow::{Context, Result};
use clerestory_transport::lamps::{FreeLamp, LampShape, PreparedLamps};
use glam::Vec3;

use super::live::View;
use super::places::{drowns, height_m};
use super::{Case, place, traced};

/// Places that drown and have others drawn for them, at most. Only references in full tell: in few samples places drown that do not in
/// many, those close to surfaces before all, and the others would be easier than what is asked.
pub const MOST_REDRAWN: usize = 5;
/// Numbers among which there are enough that keep their distance.
const MOST_NUMBERS: u32 = 100;

/// What is moved, and to how many places of each kind.
pub struct Moved {
    pub shapes: Vec<LampShape>,
    pub n_places: usize,
    /// Distance that places keep from surfaces, m.
    pub clear_m: f32,
    /// A lamp of a kind that lights a place.
    pub lamp: fn(LampShape, Vec3) -> FreeLamp,
}

/// A lamp at a place, and two pictures of its light in each of two ways, all independent of each other.
pub struct Drawn {
    /// The number that its place was drawn by.
    pub number: u32,
    /// Name of its kind.
    pub kind: &'static str,
    /// Height above the nearest surface, m.
    pub height_m: f32,
    pub lamp: PreparedLamps,
    pub traced: [Vec<f32>; 2],
    /// Its direct light alone.
    pub direct: [Vec<f32>; 2],
}

/// A number, its place, and how high that is above the nearest surface, m.
type Candidate = (u32, Vec3, f32);

impl Drawn {
    fn is_seen(&self) -> bool {
        !drowns(self.traced.each_ref().map(Vec::as_slice), self.direct.each_ref().map(Vec::as_slice))
    }
}

/// Lamps at their places, kind by kind, and how many of all places drowned.
///
/// # Errors
/// A scene that cannot be read, or a lamp that cannot shine.
pub fn draw(case: &Case, view: View<'_>, moved: &Moved) -> Result<(Vec<Drawn>, usize)> {
    let (mut all, mut n_drowned) = (Vec::new(), 0);
    for shape in &moved.shapes {
        let numbered = (0..MOST_NUMBERS).map(|number| {
            let at = place(view.scene, view.camera, view.film, number);
            (number, at, height_m(&view.scene.scene.mesh, at))
        });
        let clear = numbered.filter(|(_, _, height_m)| *height_m >= moved.clear_m);
        let mut candidates = clear.take(moved.n_places + MOST_REDRAWN);
        let (mut drawn, mut n_tried) = (Vec::new(), 0);
        while drawn.len() < moved.n_places {
            let batch: Vec<Candidate> = candidates.by_ref().take(moved.n_places - drawn.len()).collect();
            if batch.is_empty() {
                break;
            }
            n_tried += batch.len();
            drawn.extend(in_full(case, view, (shape, moved), &batch)?.into_iter().filter(Drawn::is_seen));
        }
        n_drowned += n_tried - drawn.len();
        all.extend(drawn);
    }
    Ok((all, n_drowned))
}

/// Lamps of a kind with their pictures; the direct light of all is found at the same points.
fn in_full(
    case: &Case,
    view: View<'_>,
    (shape, moved): (&LampShape, &Moved),
    batch: &[Candidate],
) -> Result<Vec<Drawn>> {
    let mut lamps = Vec::new();
    for (_, at, _) in batch {
        lamps.push(PreparedLamps::new(&[(moved.lamp)(shape.clone(), *at)], None)?.0);
    }
    let borrowed: Vec<&PreparedLamps> = lamps.iter().collect();
    let (first, second) = (view.live(&borrowed, 3, 0.0)?, view.live(&borrowed, 4, 0.0)?);
    let mut drawn = Vec::new();
    for ((&(number, _, height_m), lamp), (a, b)) in batch.iter().zip(lamps).zip(first.into_iter().zip(second)) {
        let traced = traced_alone(case, view, &lamp)?;
        drawn.push(Drawn { number, kind: shape.name(), height_m, lamp, traced, direct: [a, b] });
    }
    Ok(drawn)
}

/// Two traced pictures under a lamp alone.
fn traced_alone(case: &Case, view: View<'_>, lamp: &PreparedLamps) -> Result<[Vec<f32>; 2]> {
    let (mut lit, _) = case.without_sky()?;
    lamp.install(&mut lit)?;
    let mut coefficients = vec![[0.0; 3]; lit.lighting.basis.n_cols()];
    let last = lit.lighting.basis.sources.last().context("no lamp")?;
    coefficients[last.columns.start as usize] = (last.color * last.strength).to_array();
    traced(&lit, view.film, &coefficients, view.n_samples, [3, 4])
}

#[cfg(test)]
mod tests {
    use clerestory_transport::camera::Film;

    use super::super::lamp;
    use super::*;

    #[test]
    fn places_that_drown_are_drawn_anew_and_not_for_ever() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/scenes/gallery.glb").into();
        let case = Case { name: "gallery", path, sky: None, change: None };
        let (scene, camera) = case.prepared().unwrap();
        let film = Film { width: 16, height: 12 };
        let drawn = |n_samples: u32, moved: &Moved| {
            let view = View { scene: &scene, camera: &camera, film, n_samples };
            let (drawn, n_drowned) = draw(&case, view, moved).unwrap();
            let n_most = moved.shapes.len() * moved.n_places;
            let n_tried = drawn.len() + n_drowned;
            assert!(drawn.len() <= n_most && n_tried <= n_most + moved.shapes.len() * MOST_REDRAWN, "{n_drowned}");
            assert!(drawn.iter().all(|drawn| drawn.is_seen() && drawn.height_m >= moved.clear_m));
            assert!(drawn.is_sorted_by(|a, b| a.kind != b.kind || a.number < b.number));
            (drawn.len(), n_drowned)
        };
        // In one sample light drowns that does not in many.
        let (_, n_drowned) = drawn(1, &Moved { shapes: vec![LampShape::Point], n_places: 1, clear_m: 0.0, lamp });
        assert!(n_drowned > 0);
        let shapes = vec![LampShape::Point, LampShape::Sphere { radius_m: 0.1 }];
        let (n_drawn, _) = drawn(128, &Moved { shapes, n_places: 2, clear_m: 0.3, lamp });
        assert!(n_drawn > 0);
    }
}
