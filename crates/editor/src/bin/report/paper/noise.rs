//! PSNR against the samples of a bake, and what noise does to pictures with mirrors and caustics.

use anyhow::Result;
use clerestory_nystrom::rivals::Method;

use super::lights::{lights, psnr_db};
use super::{SEED, approximated, sampling};
use crate::desk::Desk;
use crate::methods::dense::Picture;
use crate::methods::own;
use crate::plot::{Axis, Panel, Scale, Series};
use crate::prints::jpeg;
use crate::targets::coded::Subject;

/// Rank of the rival; what ours is asked for in dB, more than noise lets it reach.
const RANK: usize = 16;
const TOLERANCE_DB: f64 = 40.0;
const NAMES: [&str; 3] = ["as sampled", "kernel", "ours"];

/// A plot, a table and a sheet of pictures.
///
/// # Errors
/// If a scene cannot be sampled or compressed.
pub(super) fn write(desk: &Desk) -> Result<String> {
    let (spp, reference_spp): (&[u32], u32) = desk.choose((&[2, 8], 32), (&[2, 8, 32, 128], 256));
    let scenes: &[&str] = desk.choose(&["caustics"], &["diffuse", "reflections", "caustics"]);
    let (mut panels, mut rows, mut shown) = (Vec::new(), String::new(), String::new());
    for name in scenes {
        let path = desk.root.join(format!("assets/scenes/{name}.glb"));
        let reference = || {
            Ok::<_, anyhow::Error>(
                own::mean_and_noise(&own::halves(desk, &path, None, (sampling(desk, reference_spp), SEED))?).0,
            )
        };
        let noisy = |spp: u32| own::halves(desk, &path, None, (sampling(desk, spp), SEED + 1));
        let curves: Vec<[Option<f64>; 3]> = desk.part("paper", &format!("noise-{name}"), || {
            let truth = reference()?;
            let point = |&spp: &u32| {
                desk.say(&format!("{name} with {spp} samples per pixel and half"));
                Ok(answers(noisy(spp)?)?.each_ref().map(|found| Some(psnr_db(&truth, found.as_ref()?))))
            };
            spp.iter().map(point).collect()
        })?;
        for (spp, dbs) in spp.iter().zip(&curves) {
            let words = dbs.map(|db| db.map_or("singular".into(), |db| format!("{db:.1}")));
            rows += &format!("| {name} | {} | {} |\n", 2 * spp, words.join(" | "));
        }
        let series = (0..NAMES.len()).map(|way| Series {
            name: NAMES[way].into(),
            points: spp.iter().zip(&curves).filter_map(|(spp, dbs)| Some([f64::from(2 * spp), dbs[way]?])).collect(),
            is_joined: true,
        });
        panels.push(Panel {
            title: (*name).into(),
            x: Axis { label: "samples per pixel", scale: Scale::Log },
            y: Axis { label: "PSNR, dB", scale: Scale::Linear },
            series: series.collect(),
        });
        if *name == "caustics" || *name == "reflections" {
            let light = &lights(16)[0];
            let found = answers(noisy(spp[1])?)?;
            let mut pictures = vec![("converged", reference()?.relit(light))];
            pictures.extend(
                NAMES.iter().zip(&found).filter_map(|(name, found)| Some((*name, found.as_ref()?.relit(light)))),
            );
            let words = format!("{name} under a small spot: converged, as sampled, `kernel`, ours");
            shown += &desk.show(&format!("paper-noise-{name}.jpg"), &words, &jpeg(&pictures)?)?;
        }
    }
    Ok(format!(
        "\n### Noise\n\n\
         PSNR in dB of matrices of few samples against one of {} per pixel with a seed of its own: as sampled, after Nyström's method on powers of\n\
         the entries at rank {RANK} (`kernel`), and after ours, which is told both halves. 256 texels. The pictures have {} samples per pixel, and one\n\
         small spot.\n{}\n| scene | samples per pixel | {} |\n|---|---|---|---|---|\n{rows}{shown}",
        2 * reference_spp,
        2 * spp[1],
        desk.plot("paper-noise", "PSNR against samples per pixel, by scene", &panels)?,
        NAMES.join(" | "),
    ))
}

/// As sampled, after the rival if it has an answer, and after ours.
fn answers(halves: [Picture; 2]) -> Result<[Option<Picture>; 3]> {
    let mean = own::mean_and_noise(&halves).0;
    let kernel = approximated(&mean, &mean.blocks(1), Method::KERNEL, RANK).ok();
    let sampled = Picture { values: mean.values.clone(), ..mean };
    let unit = mean.peak();
    let subject = Subject::new(mean, Some(halves));
    let mut ours = subject.truth.unpacked(&subject.coded(Method::Projected, TOLERANCE_DB)?.matrix);
    ours.values.iter_mut().for_each(|value| *value *= unit as f32);
    Ok([Some(sampled), kernel.map(|(found, _)| found), Some(ours)])
}
