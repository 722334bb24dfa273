//! What is told of lamps that were added.

use clerestory_transport::patches::{DEFAULT_PATCHES, Patches};
use serde::{Deserialize, Serialize};

use super::drawn::MOST_REDRAWN;
use super::places::Place;
use super::spent::Spent;
use super::twins;
use super::{BAKE_SPP, LUMEN, TRACED_SPP, WIDTHS};
use crate::desk::Desk;
use crate::fit::median;
use crate::goal::Goal;

/// What is told of scenes.
#[derive(Default, Serialize, Deserialize)]
pub struct Told {
    /// A row per scene and number of patches.
    rows: String,
    /// A row per place.
    places: String,
    pub goals: Goals,
}

/// What goals are set for, with the usual number of patches.
#[derive(Clone, Default, Serialize, Deserialize)]
pub struct Goals {
    /// Relative L2 and PSNR in dB of the places.
    l2: Vec<f64>,
    psnr_db: Vec<f64>,
    /// Kinds of the lamps of the file that were exchanged for free ones, and dB of each.
    pub exchanged: Vec<(String, f64)>,
}

/// Bytes of a file without patches, and how many more it has with them.
pub struct Bytes {
    pub without: u64,
    pub of_patches: u64,
}

pub fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

pub fn decibels(db: f64) -> String {
    format!("{db:.1} dB")
}

fn mib(bytes: u64) -> String {
    format!("{:.2} MiB", bytes as f64 / f64::from(1 << 20))
}

/// Median, and the worst; nothing of nothing.
fn spread(values: &[f64], worst: impl Fn(f64, f64) -> f64, words: impl Fn(f64) -> String) -> String {
    let worst = values.iter().copied().reduce(worst);
    median(values).zip(worst).map_or("—".into(), |(median, worst)| format!("{} ({})", words(median), words(worst)))
}

impl Goals {
    pub fn of(places: &[Place], exchanged: Vec<(String, f64)>) -> Goals {
        Goals {
            l2: places.iter().map(|place| place.l2[0]).collect(),
            psnr_db: places.iter().map(|place| place.psnr_db[0]).collect(),
            exchanged,
        }
    }

    /// Those of other places, too.
    pub fn add(&mut self, other: &Goals) {
        self.l2.extend(&other.l2);
        self.psnr_db.extend(&other.psnr_db);
        self.exchanged.extend_from_slice(&other.exchanged);
    }

    /// Cells of L2 and of PSNR.
    pub fn of_light(&self) -> String {
        let l2 = Goal::Most(0.05).of_many(&self.l2, percent);
        format!("{l2} | {}", Goal::Least(35.0).of_many(&self.psnr_db, decibels))
    }

    /// The cell of exchanged lamps, kind by kind.
    fn of_exchanged(&self) -> String {
        let mut kinds: Vec<&str> = Vec::new();
        for (kind, _) in &self.exchanged {
            if !kinds.contains(&kind.as_str()) {
                kinds.push(kind);
            }
        }
        let words = |kind: &&str| {
            let of_kind: Vec<f64> = self.exchanged.iter().filter(|(of, _)| of == kind).map(|(_, db)| *db).collect();
            format!("{kind}: {}", Goal::Least(40.0).of_many(&of_kind, decibels))
        };
        if kinds.is_empty() { "none".to_owned() } else { kinds.iter().map(words).collect::<Vec<_>>().join("; ") }
    }

    fn row(&self, name: &str, spent: Spent) -> String {
        let ratio = spent.ratio();
        format!(
            "| {name} | {} | {} | {}: {ratio:.2}× | {:.1} s | {:.1} s | {:.1} s |\n",
            self.of_light(),
            self.of_exchanged(),
            Goal::Most(1.0).word(ratio),
            spent.lights,
            spent.learning,
            spent.walks,
        )
    }
}

impl Told {
    pub fn add(&mut self, scene: &Told) {
        self.rows += &scene.rows;
        self.places += &scene.places;
    }

    /// A row of a bake with some samples per pixel, and of places, beside which some drowned.
    pub fn add_row(
        &mut self,
        (name, spp): (&str, u32),
        (places, n_drowned): (&[Place], usize),
        (patches, bytes, spent): (&Patches, Bytes, Spent),
    ) {
        let of = |what: &dyn Fn(&Place) -> f64| places.iter().map(what).collect::<Vec<f64>>();
        let energy = of(&|place| place.energy);
        let [least, most] = [f64::min, f64::max].map(|end: fn(f64, f64) -> f64| energy.iter().copied().reduce(end));
        let energy = least.zip(most).map_or("—".into(), |(least, most)| format!("{least:.3} to {most:.3}"));
        self.rows += &format!(
            "| {name} | {} | {spp} | {} | {} | {} | {} | {} | {} | {} | {energy} | {} | {} | {} | {} | {:.1} s | {:.1} s | {:.1} s |\n",
            patches.n_patches(),
            patches.n_columns(),
            percent(patches.held_out_error().into()),
            places.len(),
            n_drowned,
            spread(&of(&|place| place.l2[0]), f64::max, percent),
            spread(&of(&|place| place.l2[1]), f64::max, percent),
            spread(&of(&|place| place.noise), f64::max, percent),
            spread(&of(&|place| place.psnr_db[0]), f64::min, decibels),
            spread(&of(&|place| place.psnr_db[1]), f64::min, decibels),
            mib(bytes.without),
            mib(bytes.of_patches),
            spent.lights,
            spent.learning,
            spent.walks,
        );
    }

    pub fn add_places(&mut self, name: &str, places: &[Place]) {
        for place in places {
            let in_worst = place.in_worst.map_or("—".into(), |share| format!("{:.0} %", 100.0 * share));
            let [whole, alone] = [place.psnr_db[0], place.lamp_psnr_db].map(decibels);
            let [noise, l2] = [place.noise, place.l2[0]].map(percent);
            self.places += &format!(
                "| {name} | {} | {:.2} m | {noise} | {l2} | {:.3} | {in_worst} | {whole} | {alone} |\n",
                place.number + 1,
                place.height_m,
                place.energy,
            );
        }
    }

    /// The section: what is told of all scenes, and the goals of each with the seconds of its larger bake; headings end with `of`.
    pub fn page(&self, goals: &[(&str, Goals, Spent)], of: &str, desk: &Desk) -> String {
        let added = if of.is_empty() { twins::words() } else { String::new() };
        let goals: String = goals.iter().map(|(name, goals, spent)| goals.row(name, *spent)).collect();
        let (width, wide) = (WIDTHS[0], desk.choose(WIDTHS[0], WIDTHS[1]));
        let [spp, wide_spp] = desk.choose([64, 16], BAKE_SPP);
        let under = if of.is_empty() { "" } else { ", living-room's under its own sky" };
        format!(
            "## Lamps that were added{of}\n\n\
            A point lamp of {LUMEN} lm at places that no bake knew, in pictures {width} pixels wide. They show the baked light of the file{under} \
            ({spp} samples per pixel, or as many as the table tells, seed 0; traced and live pictures have seeds 1 to 4), plus the lamp's live light (direct light at what is seen and at what narrow lobes show there), plus what the patches make of its \
            irradiance. Two independent ones are held against two independent traced pictures of {} samples per pixel; the live light has as many. \
            L2 is the root of the summed products of both differences, over that of the indirect light: noise of live and of traced light is no error, \
            noise of the bake is; products are told as no less than their standard error over the pixels, those of PSNR, too. *Without worst* leaves out the {:.1} % of the pixels with the greatest errors, which are chosen by what is measured, \
            noise included. *Noise* is that of the mean of both traced pictures without direct light. A place where it is more than half \
            of the indirect light tells nothing, and the next number draws another one instead, {MOST_REDRAWN} times a scene at most: *drowned* counts these places. Medians, and the worst in brackets. Energy is the sum of the indirect light over that of the \
            reference. PSNR is that of the whole picture, its peak the 99.5 percentile. *Held out* is by how much columns differ from patches \
            under lamps that they were not learned from. CPU seconds of all threads: of a bake without patches, in which packing their columns is counted as well, of learning patches, of the walks of their columns. {}\n\n\
            | scene | patches | samples | columns | held out | places | drowned | L2 | without worst | noise | energy, least to most | PSNR | of the noise | file without \
            | of patches | bake without | learning | walks |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n{}\n\
            ### Place by place, {DEFAULT_PATCHES} patches{of}\n\n\
            *In the worst* is the share of the squared error that stands in these {:.1} % of the pixels, \"—\" where that error is less than its standard error; a share of more than all says that the others \
            have less than no error beside noise. *Alone* is the PSNR of the lamp's light without that of the file, direct and indirect. \
            Places keep the numbers that they were drawn by.\n\n\
            | scene | place | height above the nearest surface | noise | L2 | energy | in the worst | PSNR | alone |\n|---|---|---|---|---|---|---|---|---|\n{}\n\
            ### Goals, {DEFAULT_PATCHES} patches{of}\n\n\
            *Kept* where all keep it, else how many do; and the median. *Exchanged* are point, spot and directional lamps of the file whose place free ones of the same light take (*Make movable*), one at a time: \
            the picture of the file against the same with its baked column, whose noise counts.{added} *Bake of patches* is learning and walks over all else in CPU seconds, of a bake {wide} pixels wide \
            with {wide_spp} samples per pixel. Why L2 is missed, and what was tried: [decision 0050](decisions/0050-light-of-moved-lamps-lacks-a-little-of-everything.md) and [decision 0047](decisions/0047-the-first-bounce-stays-with-patches.md); \
            why few lamps are baked sooner than patches: [decision 0009](decisions/0009-patches-are-seen-through-learned-columns.md).\n\n\
            | scene | L2 ≤ 5 % | PSNR ≥ 35 dB | exchanged ≥ 40 dB | bake of patches ≤ 1× | bake without | learning | walks |\n|---|---|---|---|---|---|---|---|\n{goals}",
            desk.choose(TRACED_SPP[0], TRACED_SPP[1]),
            100.0 * super::places::WORST,
            desk.load_words(),
            self.rows,
            100.0 * super::places::WORST,
            self.places,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_told_which_seconds_hold_the_packing_of_patches() {
        let folder = tempfile::tempdir().unwrap();
        let desk = Desk::new(true, Some(folder.path())).unwrap();
        let told = Told::default().page(&[], "", &desk);
        assert!(
            told.contains("of a bake without patches, in which packing their columns is counted as well,"),
            "{told}"
        );
    }

    #[test]
    fn places_are_told_by_the_numbers_that_they_were_drawn_by() {
        let place = Place {
            number: 0,
            height_m: 0.5,
            l2: [0.04, 0.03],
            noise: 0.1,
            energy: 1.0,
            in_worst: Some(0.5),
            psnr_db: [40.0, 50.0],
            lamp_psnr_db: 32.5,
        };
        let third = Place { number: 2, l2: [0.06, 0.05], in_worst: None, psnr_db: [34.0, 50.0], ..place };
        let mut told = Told::default();
        told.add_places("room", &[place, third]);
        let rows = "| room | 1 | 0.50 m | 10.0 % | 4.0 % | 1.000 | 50 % | 40.0 dB | 32.5 dB |\n\
            | room | 3 | 0.50 m | 10.0 % | 6.0 % | 1.000 | — | 34.0 dB | 32.5 dB |\n";
        assert_eq!(told.places, rows);
        let exchanged = [("spot", 44.0), ("point", 39.0), ("spot", 46.0)].map(|(kind, db)| (kind.to_owned(), db));
        let goals = Goals::of(&[place, third], exchanged.to_vec());
        let row = goals.row("room", Spent { learning: 1.0, walks: 2.0, lights: 6.0 });
        let expected = "| room | missed: kept by 1 of 2, median 5.0 % | missed: kept by 1 of 2, median 37.0 dB | \
            spot: kept by all 2, median 45.0 dB; point: missed: kept by 0 of 1, median 39.0 dB | kept: 0.50× | 6.0 s | 1.0 s | 2.0 s |\n";
        assert_eq!(row, expected);
        assert_eq!(Goals::of(&[place], Vec::new()).of_exchanged(), "none");
    }
}
