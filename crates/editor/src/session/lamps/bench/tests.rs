use clerestory_transport::lamps::LampShape;

use super::*;
use crate::session::lamps::tests::{lamp, view};
use crate::session::lamps::{LampMailbox, next_order};
use crate::session::mailbox::{Clerk, Idle};

/// The closed room, and a lamp in it.
fn lit_room() -> (Arc<LampView>, FreeLamp) {
    (view(), FreeLamp { shape: LampShape::Point, ..lamp("a", 0.0) })
}

/// The same lamp at another place in the room.
fn placed(lamp: &FreeLamp, key: &str, x: f32) -> FreeLamp {
    FreeLamp { key: key.into(), position: Vec3::new(x, 0.2, -0.3), ..lamp.clone() }
}

#[test]
fn samples_are_as_many_as_what_they_take_leaves_room_for() {
    assert_eq!([1, 0].map(|bytes| samples_within(100, bytes)), [8, 8]);
    assert_eq!([25, 50, 51, 1000].map(|bytes| samples_within(100, bytes)), [4, 2, 2, 2]);
    let (view, lamp) = lit_room();
    let mut bench = Bench::new(view.clone());
    bench.take(LampOrder { view: view.clone(), lamps: vec![lamp.clone()], shows_arriving: true, serial: 1 });
    bench.step(&|_, _| false);
    let each = bench.points[0].n_bytes() + arriving::POINT_BYTES * view.film.n_pixels();
    assert!(each > 64 * view.film.n_pixels(), "{each}");
    bench.keep_within(3 * each);
    while bench.next().is_some() {
        bench.step(&|_, _| false);
    }
    assert_eq!((bench.points.len(), bench.arriving.len(), bench.n_samples), (3, 3, 3));
    assert_eq!((bench.lamps[0].n_passes, bench.lamps[0].n_arriving), (STILL_SAMPLES, 3));
    assert_eq!(bench.spare.as_ref().map(|(nth, _)| *nth), Some(31), "samples that do not fit are looked for again");
    let all_kept = StillLamps::fine(view).light(&[lamp], &|| false).unwrap();
    assert!(bench.news().unwrap().direct.pixels == all_kept.direct.pixels, "and give the same light");
}

#[test]
fn few_samples_that_are_kept_are_taken_no_more_often_than_the_others() {
    let mut bench = Bench::new(lit_room().0);
    let of_soft = |bench: &Bench| -> Vec<(usize, u32)> { (0..SOFT_PASSES).map(|p| bench.sample_of(p)).collect() };
    let most_often = |taken: &[(usize, u32)]| {
        let n_taken = |sample: usize| taken.iter().filter(|(of, _)| *of == sample).count();
        (0..STILL_SAMPLES as usize).map(n_taken).max()
    };
    for n_samples in [2, 5, 8] {
        bench.n_samples = n_samples;
        let taken = of_soft(&bench);
        let n_seen = taken.iter().enumerate().filter(|(nth, one)| !taken[..*nth].contains(one)).count();
        assert_eq!(n_seen, taken.len(), "no pass is another one's");
        assert_eq!(most_often(&taken), Some(if n_samples < 8 { 2 } else { 5 }));
    }
    // Frames look for few samples, and for none of them again and again.
    (bench.most_samples, bench.n_samples) = (8, 2);
    assert_eq!(bench.sample_of(SOFT_PASSES - 1), (1, 31));
}

#[test]
fn a_picture_is_the_sum_of_what_its_lamps_bring_whichever_of_them_changes() {
    let (view, lamp) = lit_room();
    let at = |key: &str, x: f32| placed(&lamp, key, x);
    let red = LightSetting { intensity: 3.0, color: Some([1.0, 0.0, 0.5]), ..LightSetting::default() };
    let orders = [
        vec![at("a", 0.1), at("b", 0.3), at("c", -0.3)],
        vec![at("a", 0.2), at("b", 0.3), at("c", -0.3)],
        vec![at("a", 0.25), at("b", 0.3), at("c", -0.3)],
        vec![at("a", 0.25), FreeLamp { setting: red, ..at("b", 0.3) }, at("c", -0.3)],
        vec![at("a", 0.25), at("c", -0.3)],
    ];
    let mut bench = Bench::new(view.clone());
    for (serial, lamps) in (1..).zip(orders) {
        let n_lamps = lamps.len();
        bench.take(LampOrder { view: view.clone(), lamps, shows_arriving: true, serial });
        let light = loop {
            bench.step(&|_, _| false);
            if let Some(light) = bench.news() {
                break light;
            }
        };
        assert_eq!(light.parts.len(), n_lamps);
        let arriving = light.arriving.unwrap();
        for (pixel, (direct, lux)) in (0..).zip(light.direct.pixels.iter().zip(&arriving.pixels)) {
            let seen: Vec3 = light.parts.iter().map(|part| part.direct(pixel)).sum();
            let measured: Vec3 = light.parts.iter().map(|part| part.arriving(pixel)).sum();
            for (found, expected) in [(*direct, seen), (*lux, measured)] {
                let is_it = Vec3::from(found).distance(expected) <= 1e-4 * (1.0 + expected.length());
                assert!(is_it, "order {serial}, pixel {pixel}: {found:?} is not {expected}");
            }
        }
    }
}

#[test]
fn lamps_that_are_there_are_shown_where_the_others_take_long() {
    let (view, lamp) = lit_room();
    let at = |key: &str, x: f32| placed(&lamp, key, x);
    let lamps = vec![at("a", 0.1), at("b", 0.3), at("c", -0.3)];
    let mut bench = Bench { patience: Duration::MAX, ..Bench::new(view.clone()) };
    bench.take(LampOrder { view: view.clone(), lamps, shows_arriving: false, serial: 1 });
    bench.step(&|_, _| false);
    assert!(bench.news().is_none(), "a picture is whole, unless that takes long");
    bench.patience = Duration::ZERO;
    let first = bench.news().unwrap();
    let keys = |light: &LampLight| -> Vec<String> { light.parts.iter().map(|part| part.key.clone()).collect() };
    let missing: Vec<&str> = first.left_out.iter().map(|lamp| lamp.key.as_str()).collect();
    assert_eq!((keys(&first), missing, first.is_done), (vec!["a".to_owned()], vec!["b", "c"], false));
    assert_eq!(first.missing_words().as_deref(), Some("the light of 2 lamps is not there yet"));
    let alone = first.direct.pixels.iter().zip(0..).all(|(found, pixel)| {
        let own = first.parts[0].direct(pixel);
        Vec3::from(*found).distance(own) <= 1e-4 * (1.0 + own.length())
    });
    assert!(alone && first.direct.pixels.iter().any(|rgb| rgb[1] > 0.0));
    bench.patience = Duration::MAX;
    bench.step(&|_, _| false);
    assert!(bench.news().is_none());
    bench.step(&|_, _| false);
    let whole = bench.news().unwrap();
    assert!(whole.left_out.is_empty() && whole.missing_words().is_none(), "it is shown at once");
    assert_eq!(keys(&whole), ["a", "b", "c"]);
}

#[test]
fn lamps_that_move_on_together_are_seen_on_their_way() {
    let (view, lamp) = lit_room();
    let other = Arc::new((*view).clone());
    let (sender, told) = std::sync::mpsc::channel();
    let work = move |mailbox: &LampMailbox| {
        let order = |view: &Arc<LampView>, serial: u64| {
            let x = 0.1 * serial as f32;
            let lamps = vec![placed(&lamp, "a", x), placed(&lamp, "b", -x)];
            LampOrder { view: view.clone(), lamps, shows_arriving: false, serial }
        };
        let taken =
            |bench: &Bench| next_order(mailbox, Some(bench), Idle::GoOn).flatten().map(|order: LampOrder| order.serial);
        let mut bench = Bench { patience: Duration::MAX, ..Bench::new(view.clone()) };
        bench.take(order(&view, 1));
        mailbox.lock().order = Some(order(&view, 2));
        let mut events: Vec<(&str, Option<u64>)> = Vec::new();
        for _ in 0..2 {
            events.push(("taken", taken(&bench)));
            bench.step(&|_, _| false);
            events.push(("shown", bench.news().map(|light| light.serial)));
        }
        events.push(("taken", taken(&bench)));
        bench.take(order(&view, 3));
        mailbox.lock().order = Some(order(&other, 4));
        events.push(("taken", taken(&bench)));
        sender.send(events).unwrap();
    };
    let clerk = Clerk::start("a test of orders", Arc::new(|_| ()), work).unwrap();
    let events = told.recv().unwrap();
    assert_eq!(events[..2], [("taken", None), ("shown", None)], "each of the lamps takes a pass");
    assert_eq!(events[2..5], [("taken", None), ("shown", Some(1)), ("taken", Some(2))]);
    assert_eq!(events[5], ("taken", Some(4)), "what is begun for another view is of no use");
    drop(clerk);
}

#[test]
fn many_lamps_that_move_on_together_are_seen_on_their_way() {
    let (view, lamp) = lit_room();
    let order = |serial: u64| {
        let x = 0.1 * serial as f32;
        let lamps = vec![placed(&lamp, "a", x), placed(&lamp, "b", -x)];
        LampOrder { view: view.clone(), lamps, shows_arriving: false, serial }
    };
    // Their picture takes longer than they are waited for.
    let mut bench = Bench { patience: Duration::ZERO, ..Bench::new(view.clone()) };
    let step = |bench: &mut Bench| {
        bench.step(&|_, _| false);
        (bench.news().map(|light| light.left_out.len()), bench.owes_picture())
    };
    bench.take(order(1));
    assert_eq!(step(&mut bench), (Some(1), false), "what is there is shown where none is lit");
    assert_eq!(step(&mut bench), (Some(0), false));
    bench.take(order(2));
    assert_eq!(step(&mut bench), (Some(1), true), "the other one is lit, and would go out");
    assert_eq!(step(&mut bench), (Some(0), false), "all of them are seen before they move on");
}

#[test]
fn lamps_whose_light_finds_no_memory_are_told_and_the_others_shine() {
    let (view, lamp) = lit_room();
    let at = |key: &str, x: f32| placed(&lamp, key, x);
    let lamps = vec![at("a", 0.1), at("b", 0.3), at("c", -0.3)];
    let mut bench = Bench::new(view.clone());
    // What is lit already takes no more than it has.
    for (serial, n_fit) in [(1, 2), (2, 0)] {
        bench.take(LampOrder { view: view.clone(), lamps: lamps.clone(), shows_arriving: false, serial });
        bench.stay_within(n_fit * bench.lamp_bytes());
        let light = loop {
            bench.step(&|_, _| false);
            if let Some(light) = bench.news() {
                break light;
            }
        };
        assert!(light.parts.iter().map(|part| part.key.as_str()).eq(["a", "b"]));
        let is_told = |words: &str| words.contains("1 of 3 lamps") && words.contains("32 × 24");
        assert!(matches!(&light.problems[..], [words] if is_told(words)), "{:?}", light.problems);
    }
    bench.take(LampOrder { view, lamps, shows_arriving: false, serial: 3 });
    bench.stay_within(bench.lamp_bytes());
    assert!(bench.lamps.len() == 3 && bench.problems().is_empty(), "there is memory again");
}

#[test]
fn light_that_was_put_together_is_kept_for_as_long_as_the_lamps_stay() {
    let (view, lamp) = lit_room();
    let mut still = StillLamps::new(view);
    let mut light = |lamp: &FreeLamp| still.light(std::slice::from_ref(lamp), &|| false).unwrap();
    let first = light(&lamp);
    assert!(Arc::ptr_eq(&first.direct, &light(&lamp).direct));
    let other = light(&FreeLamp { strength: 200.0, ..lamp.clone() });
    assert!(other.direct.pixels != first.direct.pixels);
    assert!(light(&lamp).direct.pixels == first.direct.pixels);
}
