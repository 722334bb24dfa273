//! PSNR against the ratio of compression on panels of many texels, and rank against their number.

use anyhow::Result;
use clerestory_nystrom::CompressConfig;
use clerestory_nystrom::rivals::Method;
use clerestory_transport::camera::Film;
use serde::{Deserialize, Serialize};

use super::components::Components;
use super::lights::psnr_db;
use super::{Repeats, SEED, approximated, middle, repeated, sampling, told};
use crate::desk::Desk;
use crate::fit::{digits, secs_at};
use crate::methods::dense::Picture;
use crate::methods::own;
use crate::plot::{Axis, Panel, Scale, Series};
use crate::targets::coded::Subject;
use crate::targets::soft;

/// Ranks of the rivals, and what is packed is asked for in dB.
const RANKS: [usize; 5] = [2, 4, 8, 16, 32];
const TOLERANCES_DB: [f64; 6] = [20.0, 25.0, 30.0, 35.0, 40.0, 45.0];
/// Error of the ranks that are told, in dB of single texels.
const RANK_DB: f64 = 40.0;
/// Bytes of a number of a rival: rounding is not held against them.
const BYTES: f64 = 2.0;
const NAMES: [&str; 4] = ["ours, packed", "`svd`, packed", "`svd` in 16-bit numbers", "`kernel` in 16-bit numbers"];
/// A rank that changes by no more than this factor is called constant.
const CONSTANT: f64 = 1.25;

/// Dense in single precision over bytes, and PSNR in dB with each seed.
type Curve = Vec<(f64, Repeats)>;

/// What is known of one number of texels.
#[derive(Serialize, Deserialize)]
struct Resolution {
    side: usize,
    /// In the order of [`NAMES`].
    curves: [Curve; NAMES.len()],
    /// Mean rank of the blocks: the least for the error that is told, and that of ours.
    ranks: [f64; 2],
}

/// A plot and two tables.
///
/// # Errors
/// If the scene cannot be sampled or compressed.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let (finest, spp) = desk.choose((16, 16), (64, 64));
    let path = desk.root.join("assets/scenes/diffuse.glb");
    let mut found = Vec::new();
    let mut side = finest;
    while side >= 8 {
        found.push(desk.part("paper", &format!("ratios-{side}"), || {
            let halves = own::halves(desk, &path, Some(finest as u32), (sampling(desk, spp), SEED))?;
            resolution(desk, halves.map(|half| summed(half, side)), desk.choose(8, 32))
        })?);
        side /= 2;
    }
    found.reverse();
    let exact: Vec<[f64; 3]> = desk.part("paper", "ranks-exact", || exact_ranks(desk, finest))?;
    let (mut panels, mut rows, mut ranks) = (Vec::new(), String::new(), String::new());
    for (Resolution { side, curves, ranks: [least, ours] }, exact) in found.iter().zip(&exact) {
        let exact = exact.map(|rank| format!("{rank:.1}")).join(" | ");
        ranks += &format!("| {side} × {side} | {exact} | {least:.1} | {ours:.1} |\n");
        for (name, curve) in NAMES.iter().zip(curves).filter(|(_, curve)| !curve.is_empty()) {
            let words: Vec<String> = curve.iter().map(|(ratio, db)| format!("{ratio:.0}×, {} dB", told(db))).collect();
            rows += &format!("| {side} × {side} | {name} | {} |\n", words.join(" | "));
        }
        panels.extend(Some(panel(*side, curves)).filter(|panel| !panel.series.is_empty()));
    }
    let film = sampling(desk, spp).film;
    Ok(format!(
        "\n### Ratios\n\n\
         `diffuse`, {} × {} pixels under a panel of {finest} × {finest} texels of {} samples per pixel; coarser panels are its texels summed. Ratio of\n\
         the dense matrix in single precision to the bytes, and PSNR in dB against it: ours asked for {} dB of single texels and packed as a file has it;\n\
         principal components (`svd`) with a rank for each block for the same tolerances, packed alike but for dark blocks, which ours holds to less; then at ranks {}, as Nyström's method after a transform\n\
         (`kernel`), two bytes for each number. `kernel` has the seeds that are told above on the same samples; all else has one, as `svd` draws nothing and ours is compressed with one. Of the four scenes of the table Columns this is the easiest,\n\
         so that the others are compressed less than it says.{}\n{}\n\
         | texels | method |{}\n|---|---|{}\n{rows}\n\
         ### Rank against texels\n\n\
         Mean rank of blocks of 16 × 16 pixels for {RANK_DB} dB of single texels, the least there is and that of ours. First of a matrix without noise: the floor, wall\n\
         and balls of the section Targets, and the least without the balls, which throw all of its shadows; both least ranks are there those for the error that ours reaches, which is asked for {RANK_DB} dB. Then of `diffuse` as sampled: the least for the mean of both halves, whose noise counts as something to be kept, and\n\
         ours, which is told both halves and keeps what they agree about. As sampled it is the easiest of the four scenes alone; all ranks have one seed each, the samples {SEED}, what ours draws {}.\n\n\
         | texels | without noise: least | ours | without shadows: least | `diffuse`: least | ours |\n|---|---|---|---|---|---|\n{ranks}\n{}{}\n",
        film.width,
        film.height,
        2 * spp,
        TOLERANCES_DB.map(|db| db.to_string()).join(", "),
        RANKS.map(|rank| rank.to_string()).join(", "),
        packing_words(&found),
        desk.plot("paper-ratios", "PSNR against the ratio of compression, by number of texels", &panels)?,
        " dense / bytes, PSNR |".repeat(TOLERANCES_DB.len()),
        "---|".repeat(TOLERANCES_DB.len()),
        CompressConfig::default().seed,
        is_it_constant(&found, &exact),
        why(&exact),
    ))
}

/// What the kernel is to be held against, and why.
fn packing_words(found: &[Resolution]) -> String {
    let gain = packing_gain(found).map(digits);
    gain.map_or(String::new(), |times| {
        format!(
            " Packing alone makes `svd` up to {times} times smaller at like PSNR, so the kernel is to be held against `svd` in 16-bit numbers."
        )
    })
}

/// How many times smaller packing alone makes leading components, at most: at the PSNR of each point that is packed, between those of
/// 16-bit numbers around it.
fn packing_gain(found: &[Resolution]) -> Option<f64> {
    let gains = |Resolution { curves: [_, packed, plain, _], .. }: &Resolution| -> Vec<f64> {
        let plain = points(plain);
        points(packed).into_iter().filter_map(|[ratio, db]| Some(ratio / secs_at(db, &plain)?)).collect()
    };
    found.iter().flat_map(gains).max_by(f64::total_cmp)
}

/// (ratio, dB) of a curve.
fn points(curve: &Curve) -> Vec<[f64; 2]> {
    curve.iter().filter_map(|(ratio, db)| Some([*ratio, middle(db)?])).collect()
}

/// Curves of a number of texels; those that were not measured are left out.
fn panel(side: usize, curves: &[Curve; NAMES.len()]) -> Panel {
    let series = NAMES.iter().zip(curves).filter(|(_, curve)| !curve.is_empty()).map(|(name, curve)| Series {
        name: name.replace('`', ""),
        points: points(curve),
        is_joined: true,
    });
    Panel {
        title: format!("{side} × {side} texels"),
        x: Axis { label: "dense / bytes", scale: Scale::Log },
        y: Axis { label: "PSNR, dB", scale: Scale::Linear },
        series: series.collect(),
    }
}

/// The paper's question about the rank, answered by the coarsest panel and the finest.
fn is_it_constant(found: &[Resolution], exact: &[[f64; 3]]) -> String {
    let ends = found.first().zip(found.last()).zip(exact.first().zip(exact.last()));
    let Some(((coarse, fine), (coarse_exact, fine_exact))) = ends else { return String::new() };
    let growth = |of_coarse: f64, of_fine: f64| of_fine / of_coarse;
    let exact = [0, 1].map(|which| growth(coarse_exact[which], fine_exact[which]));
    let sampled = [0, 1].map(|which| growth(coarse.ranks[which], fine.ranks[which]));
    format!(
        "Is it constant, as the paper says? From {0} × {0} to {1} × {1} texels, {2} times as many, the least rank without noise {3}, ours {4}; \
         of `diffuse` as sampled the least, which holds the noise, {5}, and ours {6}. Constant is what changes by no more than a factor of {CONSTANT}.",
        coarse.side,
        fine.side,
        (fine.side / coarse.side).pow(2),
        growth_words(exact[0]),
        growth_words(exact[1]),
        growth_words(sampled[0]),
        growth_words(sampled[1]),
    )
}

/// What the ranks without noise tell of why they grow.
fn why(exact: &[[f64; 3]]) -> String {
    let Some((coarse, fine)) = exact.first().zip(exact.last()) else { return String::new() };
    let [shadowed, _, unshadowed]: [f64; 3] = std::array::from_fn(|which| fine[which] / coarse[which]);
    let steps: Vec<String> = exact.windows(2).map(|pair| format!("{:.2}", pair[1][0] / pair[0][0])).collect();
    let reason = match (shadowed > CONSTANT, unshadowed <= CONSTANT) {
        (true, true) => {
            ": what takes more components on finer panels is their shadows. A coarser texel is the sum of finer ones, so that \
             its shadow is softer, while the error that is asked for is that of each texel by itself, below the brightest of \
             them: edges of shadows count on a fine panel that are summed away on a coarse one."
        }
        (true, false) => ": shadows are not all that takes more components on finer panels.",
        (false, _) => ".",
    };
    format!(
        " From each number of texels to the next the least rank without noise grows {} times. Without shadows it {}{reason}",
        steps.join(", "),
        growth_words(unshadowed),
    )
}

fn growth_words(factor: f64) -> String {
    match factor {
        factor if (1.0 / CONSTANT..=CONSTANT).contains(&factor) => format!("is constant ({factor:.2} times)"),
        factor if factor > 1.0 => format!("is not constant, it grows {factor:.1} times"),
        factor => format!("is not constant, it shrinks to {factor:.2} times"),
    }
}

fn summed(mut picture: Picture, side: usize) -> Picture {
    while picture.n_cols > side * side {
        picture = picture.coarser();
    }
    picture
}

/// Curves of panels of at least so many texels along a side, and ranks of all.
fn resolution(desk: &Desk, halves: [Picture; 2], least_of_curves: usize) -> Result<Resolution> {
    let side = halves[0].n_cols.isqrt();
    desk.say(&format!("ratios and ranks of {side} × {side} texels"));
    let mean = || own::mean_and_noise(&halves).0;
    let mut curves = [const { Curve::new() }; NAMES.len()];
    if side >= least_of_curves {
        curves = all_curves(desk, mean())?;
    }
    let subject = Subject::new(mean(), Some(halves));
    let least = subject.spectrum.least_mean_rank(10f64.powf(-RANK_DB / 10.0));
    let ours = subject.coded(Method::Projected, RANK_DB)?.mean_rank;
    Ok(Resolution { side, curves, ranks: [least, ours] })
}

/// Every method at each of its tolerances or ranks.
fn all_curves(desk: &Desk, picture: Picture) -> Result<[Curve; NAMES.len()]> {
    let mut curves = [const { Curve::new() }; NAMES.len()];
    let subject = Subject::new(picture, None);
    let (truth, blocks) = (&subject.truth, subject.truth.blocks::<f32>(1));
    let dense_bytes = size_of_val(&truth.values[..]) as f64;
    let components = Components::new(&blocks)?;
    for tolerance in TOLERANCES_DB {
        let coded = subject.coded(Method::Projected, tolerance)?;
        curves[0].push((coded.ratio, Some(vec![psnr_db(truth, &truth.unpacked(&coded.matrix))])));
        let (bytes, matrix) = components.packed(truth, 10f64.powf(-tolerance / 10.0))?;
        curves[1].push((dense_bytes / bytes as f64, Some(vec![psnr_db(truth, &truth.unpacked(&matrix))])));
    }
    for rank in RANKS {
        let ratio = |n_values: usize| dense_bytes / (BYTES * n_values as f64);
        let (found, n_values) = components.leading(truth, rank)?;
        curves[2].push((ratio(n_values), Some(vec![psnr_db(truth, &found)])));
        let mut of_kernel = f64::NAN;
        let found = repeated(desk, Method::KERNEL, |seed| {
            let (found, n_values) = approximated(truth, &blocks, Method::KERNEL, (rank, seed)).ok()?;
            of_kernel = ratio(n_values);
            Some(psnr_db(truth, &found))
        });
        // What has no answer is no point of the curve.
        curves[3].extend(found.map(|db| (of_kernel, Some(db))));
    }
    Ok(curves)
}

/// Mean ranks of a matrix without noise, the least, ours, and the least without shadows, of panels from 8 × 8 texels to `finest`.
fn exact_ranks(desk: &Desk, finest: usize) -> Result<Vec<[f64; 3]>> {
    let Film { width, height } = sampling(desk, 1).film;
    let (width, height) = (width as usize, height as usize);
    let mut found = Vec::new();
    let mut pictures = [soft::picture(width, height, finest), soft::unshadowed(width, height, finest)];
    loop {
        let side = pictures[0].n_cols.isqrt();
        desk.say(&format!("ranks of {side} × {side} texels without noise"));
        let next = (side > 8).then(|| pictures.each_ref().map(Picture::coarser));
        let [shadowed, unshadowed] = pictures.map(|picture| Subject::new(picture, None));
        let ours = shadowed.coded(Method::Projected, RANK_DB)?;
        // All at the error that ours has reached.
        let [least, without] =
            [shadowed, unshadowed].map(|subject| subject.spectrum.least_mean_rank(ours.judged.mean_square()));
        found.push([least, ours.mean_rank, without]);
        match next {
            Some(next) => pictures = next,
            None => break,
        }
    }
    found.reverse();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rank_is_constant_only_if_it_hardly_changes() {
        let resolution = |side, ranks| Resolution { side, curves: [const { Curve::new() }; NAMES.len()], ranks };
        let found = [resolution(8, [50.0, 6.0]), resolution(16, [200.0, 7.0]), resolution(64, [500.0, 3.0])];
        let words = is_it_constant(&found, &[[10.0, 12.0, 4.0], [11.0, 20.0, 4.0], [12.0, 36.0, 4.0]]);
        assert!(words.contains("From 8 × 8 to 64 × 64 texels, 64 times as many"), "{words}");
        assert!(words.contains(
            "the least rank without noise is constant (1.20 times), ours is not constant, it grows 3.0 times;"
        ));
        assert!(words.contains(
            "which holds the noise, is not constant, it grows 10.0 times, and ours is not constant, it shrinks to 0.50"
        ));
        assert_eq!(is_it_constant(&[], &[]), "");
    }

    #[test]
    fn the_kernel_is_held_against_what_is_packed_as_little() {
        let curve = |points: &[[f64; 2]]| points.iter().map(|[ratio, db]| (*ratio, Some(vec![*db]))).collect::<Curve>();
        let plain = curve(&[[100.0, 20.0], [25.0, 40.0]]);
        // Between both points, and beyond the last.
        let packed = curve(&[[150.0, 30.0], [90.0, 45.0]]);
        let found = [Resolution { side: 8, curves: [Curve::new(), packed, plain, Curve::new()], ranks: [0.0; 2] }];
        assert!(packing_gain(&found).is_some_and(|gain| (gain - 3.0).abs() < 1e-9));
        assert!(packing_words(&found).contains("up to 3.0 times smaller at like PSNR"));
        assert_eq!(packing_words(&[]), "");
    }

    #[test]
    fn shadows_are_the_reason_only_if_the_rank_is_constant_without_them() {
        let words = |ends: [[f64; 2]; 2]| why(&ends.map(|[least, without]| [least, 0.0, without]));
        let shadows = words([[10.0, 4.0], [28.0, 4.4]]);
        assert!(
            shadows.contains("grows 2.80 times. Without shadows it is constant (1.10 times): what takes"),
            "{shadows}"
        );
        let more = words([[10.0, 4.0], [28.0, 8.0]]);
        assert!(more.contains("it is not constant, it grows 2.0 times: shadows are not all"), "{more}");
        let constant = words([[10.0, 4.0], [11.0, 4.0]]);
        assert!(constant.ends_with("Without shadows it is constant (1.00 times)."), "{constant}");
        assert_eq!(why(&[]), "");
    }
}
