//! Laws of the files: what is written comes back, every version stays readable, and damage is seen.

use super::*;
use crate::bake::{BakeHeader, Grounds};
use crate::light::LightRig;

/// A file of each version, as the programs of their time wrote them.
const FIXTURES: [(u32, &[u8]); 9] = [
    (1, include_bytes!("../../tests/data/v1.transport")),
    (2, include_bytes!("../../tests/data/v2.transport")),
    (3, include_bytes!("../../tests/data/v3.transport")),
    (4, include_bytes!("../../tests/data/v4.transport")),
    (5, include_bytes!("../../tests/data/v5.transport")),
    (6, include_bytes!("../../tests/data/v6.transport")),
    (7, include_bytes!("../../tests/data/v7.transport")),
    (8, include_bytes!("../../tests/data/v8.transport")),
    (9, include_bytes!("../../tests/data/v9.transport")),
];

fn decoded(bytes: &[u8]) -> Result<Bake, ArchiveError> {
    decode(bytes, Path::new("a.transport"))
}

/// The file as this program writes it.
fn encoded(bake: &Bake) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport");
    write(bake, &path).unwrap();
    fs::read(path).unwrap()
}

fn is_same(a: &Bake, b: &Bake) -> bool {
    let blocks = |bake: &Bake| -> Vec<Vec<Option<Arc<BlockFactors>>>> {
        let all = std::iter::once(&bake.groups).chain(&bake.irradiance).flatten();
        all.map(|group| group.blocks.clone()).collect()
    };
    a.header == b.header && blocks(a) == blocks(b)
}

/// Mean over all rows under the light of the file.
fn mean(bake: &Bake) -> f64 {
    let coefficients = bake.header.coefficients(&LightRig::default());
    let rows = bake.groups.iter().zip(coefficients).map(|(group, coefficients)| {
        let red: Vec<f32> = coefficients.iter().map(|rgb| rgb[0]).collect();
        group.apply(&red).into_iter().map(f64::from).sum::<f64>() / group.n_rows() as f64
    });
    rows.sum()
}

#[test]
fn a_file_of_each_version_stays_readable() {
    let expected = [
        (20, 18, 1, 0),
        (10, 8, 292, 0),
        (18, 9, 1, 2),
        (18, 9, 3, 0),
        (18, 9, 19, 0),
        (18, 9, 19, 0),
        (10, 8, 292, 0),
        (18, 9, 18, 0),
        (18, 9, 18, 0),
    ];
    for ((version, bytes), (width, height, n_cols, n_sets)) in FIXTURES.iter().zip(expected) {
        assert_eq!(bytes[8..12], version.to_le_bytes());
        let bake = decoded(bytes).unwrap();
        let header = &bake.header;
        assert_eq!((header.width, header.height, header.basis.n_cols()), (width, height, n_cols), "version {version}");
        assert_eq!((bake.irradiance.len(), header.basis.sky.is_some()), (n_sets, [2, 7].contains(version)));
        assert!(bake.groups.iter().all(|group| group.blocks.iter().all(Option::is_some)));
        let mean = mean(&bake);
        assert!(mean > 0.05 && mean < 5.0, "version {version}: {mean}");
        assert_eq!(header.patches.is_some(), [5, 6, 8, 9].contains(version));
        // What this program makes of it holds the same.
        assert!(is_same(&decoded(&encoded(&bake)).unwrap(), &bake), "version {version}");
    }
}

#[test]
fn of_the_newest_version_a_file_is_kept_too() {
    assert_eq!(FIXTURES.map(|(version, _)| version), std::array::from_fn(|nth| nth as u32 + 1));
    assert_eq!(FIXTURES.len(), VERSION as usize);
}

#[test]
fn a_version_to_come_is_refused_with_advice() {
    for version in [0, VERSION + 1, u32::MAX] {
        let mut bytes = FIXTURES[1].1.to_vec();
        bytes[8..12].copy_from_slice(&version.to_le_bytes());
        let said = decoded(&bytes).unwrap_err().to_string();
        assert!(said.contains(&format!("format version {version}")) && said.contains("update the program"), "{said}");
    }
}

#[test]
fn every_flipped_bit_is_seen_or_changes_nothing() {
    for (version, bytes) in FIXTURES {
        let bake = decoded(bytes).unwrap();
        let written = encoded(&bake);
        for at in 0..written.len() {
            let mut flipped = written.clone();
            flipped[at] ^= 1 << (at % 8);
            // Before files were packed, the name of the checksum in the header may change, and then says nothing.
            let harmless = decoded(&flipped).map_or(true, |read| version < 4 && is_same(&read, &bake));
            assert!(harmless, "version {version}, byte {at}");
        }
    }
}

#[test]
fn without_a_checksum_of_its_header_the_blocks_of_an_old_file_are_checked_all_the_same() {
    for (version, bytes) in FIXTURES {
        let header_len = 16 + u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        for at in 0..bytes.len() {
            let mut flipped = bytes.to_vec();
            flipped[at] ^= 1 << (at % 8);
            assert!(decoded(&flipped).is_err() || at < header_len, "version {version}, byte {at}");
        }
    }
}

#[test]
fn a_file_that_is_cut_or_longer_is_refused() {
    for (version, bytes) in FIXTURES {
        for len in (0..bytes.len()).step_by(7).chain([bytes.len() - 1]) {
            assert!(decoded(&bytes[..len]).is_err(), "version {version}, {len} bytes");
        }
        assert!(decoded(&[bytes, &[0]].concat()).unwrap_err().to_string().contains("longer"), "version {version}");
    }
}

/// A file whose header was changed by somebody who knows the format.
fn forged(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let len = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    let json = String::from_utf8(bytes[16..16 + len].to_vec()).unwrap();
    assert!(json.contains(from), "{json}");
    let json = json.replacen(from, to, 1);
    [&bytes[..12], &(json.len() as u32).to_le_bytes(), json.as_bytes(), &bytes[16 + len..]].concat()
}

#[test]
fn what_a_header_asks_for_is_held_against_the_bytes_that_are_there() {
    let bytes = FIXTURES[0].1;
    for (from, to) in [
        ("\"width\":20", "\"width\":16384"),
        ("\"tile\":16", "\"tile\":1"),
        ("\"width\":20,\"height\":18,\"tile\":16", "\"width\":16384,\"height\":16384,\"tile\":1"),
        ("\"width\":20", "\"width\":0"),
        ("\"width\":20", "\"width\":4294967295"),
        ("\"tile\":16", "\"tile\":0"),
        ("\"column_scale\":[", "\"column_scale\":[1e39,"),
        ("\"strength\":3.0", "\"strength\":1e39"),
        ("\"groups\":[", "\"groups\":[{\"kind\":\"panel\",\"columns\":{\"start\":0,\"end\":0}},"),
    ] {
        let said = decoded(&forged(bytes, from, to)).unwrap_err().to_string();
        assert!(said.contains("damaged"), "{to}: {said}");
    }
    // The columns of one light in two groups.
    let [whole, first, rest] = [(1, 292), (1, 100), (100, 292)]
        .map(|(start, end)| format!("{{\"kind\":\"sky\",\"columns\":{{\"start\":{start},\"end\":{end}}}}}"));
    let said = decoded(&forged(FIXTURES[1].1, &whole, &format!("{first},{rest}"))).unwrap_err().to_string();
    assert!(said.contains("columns without a light"), "{said}");
    let mut long = bytes.to_vec();
    long[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(decoded(&long).unwrap_err().to_string().contains("ends in its header"));
}

#[test]
fn a_file_whose_factors_do_not_fit_the_machine_is_refused_before_they_are_made() {
    let (_, bytes) = FIXTURES[7];
    let path = Path::new("a.transport");
    let within = |memory_bytes: u64| decode_within(Some(memory_bytes), bytes, path);
    assert!(is_same(&within(1 << 30).unwrap(), &decoded(bytes).unwrap()));
    let refused = within(100).map(|bake| bake.header).unwrap_err();
    assert!(matches!(refused, ArchiveError::TooLarge { gigabytes: 1, most: 0, .. }), "{refused}");
}

fn part_of_fixture(path: &Path) -> (BakeHeader, Vec<Vec<Arc<BlockFactors>>>) {
    let bake = decoded(FIXTURES[0].1).unwrap();
    let header = BakeHeader::clone(&bake.header);
    let (mut part, done) = Part::open(path, header.clone(), Restart::Resume).unwrap();
    assert!(done.is_empty());
    let n_blocks = header.partition().n_blocks();
    let block = |idx: usize| -> Vec<_> { bake.groups.iter().filter_map(|group| group.blocks[idx].clone()).collect() };
    let blocks: Vec<_> = (0..n_blocks).map(block).collect();
    for (number, factors) in blocks.iter().enumerate().rev() {
        part.append(number, factors).unwrap();
    }
    (header, blocks)
}

#[test]
fn of_a_damaged_half_done_bake_the_blocks_before_the_damage_are_taken_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let (header, blocks) = part_of_fixture(&path);
    let whole = fs::read(&path).unwrap();
    let start = header_bytes(b"CLERPAR2", &header, Blocks::Plain).len();
    for at in (start..whole.len()).step_by(5) {
        let mut flipped = whole.clone();
        flipped[at] ^= 1 << (at % 8);
        for bytes in [&flipped, &whole[..at]] {
            fs::write(&path, bytes).unwrap();
            let (part, done) = Part::open(&path, header.clone(), Restart::Resume).unwrap();
            assert!(done.len() < blocks.len(), "byte {at}");
            assert!(done.iter().all(|(number, factors)| *factors == blocks[*number]), "byte {at}");
            let state = part_state(&path).unwrap();
            assert_eq!((state.n_done, state.n_blocks, state.n_torn_bytes), (done.len(), blocks.len(), 0));
            // What follows is written behind the last whole record.
            assert!(whole.starts_with(&fs::read(&path).unwrap()), "byte {at}");
            drop(part);
        }
    }
}

#[test]
fn a_half_done_bake_is_read_in_memory_for_its_records_alone() {
    use crate::basis::{ColumnGroup, ColumnKind, LightBasis, LightSource, SourceKind};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let (mut header, _) = part_of_fixture(&path);
    // A place for each block of each group would take 2 TB.
    let columns = || (0..1000u32).map(|nth| nth..nth + 1);
    let source = |columns| LightSource::plain("lamp", SourceKind::Emitter, columns);
    header.basis = LightBasis::new(columns().map(source).collect());
    header.basis.groups = columns().map(|columns| ColumnGroup { kind: ColumnKind::Luminaire, columns }).collect();
    header.column_scale = vec![1.0; 1000];
    let side = crate::camera::Film::MAX_SIDE;
    (header.width, header.height, header.tile) = (side, side, 1);
    fs::write(&path, header_bytes(b"CLERPAR2", &header, Blocks::Plain)).unwrap();
    let state = part_state(&path).unwrap();
    assert_eq!((state.n_done, state.n_blocks, state.n_torn_bytes), (0, 1 << 28, 0));
}

#[test]
fn half_done_bakes_of_older_programs_are_taken_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let (header, blocks) = part_of_fixture(&path);
    let mut old = header_bytes(b"CLERPART", &header, Blocks::Plain);
    for (number, factors) in blocks.iter().enumerate().skip(1) {
        old.extend((number as u32).to_le_bytes());
        factors.iter().for_each(|factors| encode_block(factors, &mut old));
    }
    fs::write(&path, &old).unwrap();
    let (mut part, done) = Part::open(&path, header.clone(), Restart::Resume).unwrap();
    assert_eq!(done.len(), blocks.len() - 1);
    part.append(0, &blocks[0]).unwrap();
    drop(part);
    let (_, done) = Part::open(&path, header, Restart::Resume).unwrap();
    assert_eq!(done.len(), blocks.len());
}

#[test]
fn a_bake_under_way_in_another_scale_is_started_over() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport");
    let (header, blocks) = part_of_fixture(&part_of(&path));
    let n_kept = |header: &BakeHeader| {
        let (mut under_way, half_done) = UnderWay::beside(&path).unwrap();
        assert_eq!(half_done.unwrap().blocks.len(), blocks.len());
        let header = Arc::new(header.clone());
        under_way.heed(&BakeEvent::Started { header, n_blocks: blocks.len(), n_passes: 1 }).unwrap();
        drop(under_way);
        part_state(&part_of(&path)).unwrap().n_done
    };
    assert_eq!(n_kept(&header), blocks.len());
    let mut other = header.clone();
    other.column_scale[0] *= 2.0;
    assert_eq!(n_kept(&other), 0, "its blocks would be half as bright");
}

#[test]
fn two_bakes_to_one_file_do_not_meet() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let header = BakeHeader::clone(&decoded(FIXTURES[0].1).unwrap().header);
    let (part, _) = Part::open(&path, header.clone(), Restart::Resume).unwrap();
    for restart in [Restart::Resume, Restart::Fresh] {
        let second = Part::open(&path, header.clone(), restart).err().expect("the first one holds it");
        assert!(matches!(second, ArchiveError::Busy { .. }), "{second}");
    }
    // A lock ends with its holder, whatever became of the file.
    part.remove();
    assert!(!path.exists());
    drop(Part::open(&path, header.clone(), Restart::Resume).unwrap());
    drop(Part::open(&path, header, Restart::Resume).unwrap());
}

#[test]
fn what_is_no_half_done_bake_is_not_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.part");
    let header = BakeHeader::clone(&decoded(FIXTURES[0].1).unwrap().header);
    let mut newer = header_bytes(b"CLERPAR2", &header, Blocks::Plain);
    newer[8] = 99;
    for (bytes, words) in [(&b"a letter to a friend"[..], "in the way"), (&newer, "version 99")] {
        fs::write(&path, bytes).unwrap();
        let said = Part::open(&path, header.clone(), Restart::Resume).err().expect("refused").to_string();
        assert!(said.contains(words), "{said}");
        assert_eq!(fs::read(&path).unwrap(), bytes);
        drop(Part::open(&path, header.clone(), Restart::Fresh).unwrap());
    }
    // A kill before the header was there leaves its beginning.
    for len in [0, 3, 8, 20] {
        fs::write(&path, &header_bytes(b"CLERPAR2", &header, Blocks::Plain)[..len]).unwrap();
        assert!(Part::open(&path, header.clone(), Restart::Resume).unwrap().1.is_empty());
    }
}

#[test]
fn a_failed_write_leaves_the_old_file_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport");
    let [first, second] = [0, 2].map(|i| decoded(FIXTURES[i].1).unwrap());
    write(&first, &path).unwrap();
    let old = fs::read(&path).unwrap();
    // A name that is too long, a folder in the way, and one that is gone.
    let long = folder.path().join("a".repeat(256));
    assert!(matches!(write(&second, &long), Err(ArchiveError::Io { .. })));
    let in_the_way = folder.path().join("b.transport");
    fs::create_dir(&in_the_way).unwrap();
    assert!(matches!(write(&second, &in_the_way), Err(ArchiveError::Io { .. })));
    let names = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!((fs::read(&path).unwrap(), names), (old, 2), "nothing is left of what failed");
    let gone = folder.path().join("gone").join("a.transport");
    let said = write(&second, &gone).unwrap_err().to_string();
    assert!(said.contains("cannot create") && said.contains("gone"), "{said}");
}

#[cfg(unix)]
#[test]
fn a_bake_is_written_through_links() {
    let folder = tempfile::tempdir().unwrap();
    let (link, target) = (folder.path().join("a.transport"), folder.path().join("b.transport"));
    std::os::unix::fs::symlink("b.transport", &link).unwrap();
    // At first the link dangles, then there is a file to replace.
    for i in [0, 2] {
        let bake = decoded(FIXTURES[i].1).unwrap();
        write(&bake, &link).unwrap();
        assert!(link.is_symlink() && is_same(&read(&target).unwrap(), &bake));
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn two_who_write_one_file_at_once_leave_it_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport");
    let bakes = [0, 2].map(|i| decoded(FIXTURES[i].1).unwrap());
    let wholes = bakes.each_ref().map(|bake| {
        write(bake, &path).unwrap();
        fs::read(&path).unwrap()
    });
    let (path, wholes) = (&path, &wholes);
    std::thread::scope(|scope| {
        for bake in &bakes {
            scope.spawn(move || (0..100).for_each(|_| write(bake, path).unwrap()));
        }
        for _ in 0..200 {
            let bytes = fs::read(path).unwrap();
            assert!(wholes.contains(&bytes), "it is a mixture of both");
        }
    });
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn a_file_that_is_replaced_while_it_is_read_is_one_of_both() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport");
    let bakes = [0, 2].map(|i| decoded(FIXTURES[i].1).unwrap());
    write(&bakes[0], &path).unwrap();
    let (path, bakes) = (&path, &bakes);
    let ended = std::sync::atomic::AtomicBool::new(false);
    rayon::join(
        || {
            for turn in 0..50 {
                write(&bakes[turn % 2], path).unwrap();
            }
            ended.store(true, std::sync::atomic::Ordering::Relaxed);
        },
        || {
            while !ended.load(std::sync::atomic::Ordering::Relaxed) {
                let found = read(path).unwrap();
                assert!(bakes.iter().any(|bake| is_same(bake, &found)));
            }
        },
    );
}

#[test]
fn a_half_done_bake_of_another_method_is_not_taken_up() {
    use clerestory_nystrom::rivals::{Core, Method};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport.part");
    let (header, _) = part_of_fixture(&path);
    let mut by_svd = header.clone();
    by_svd.config.method = Method::Svd;
    let Err(ArchiveError::OtherBake { difference, .. }) = Part::open(&path, by_svd.clone(), Restart::Resume) else {
        panic!("another method was taken up")
    };
    assert!(difference.contains("options"), "{difference}");
    // A method is kept by its name, and our own is not told.
    let json = |header: &BakeHeader| serde_json::to_value(&header.config).unwrap();
    assert_eq!((json(&header).get("method"), json(&by_svd)["method"].as_str()), (None, Some("svd")));
    by_svd.config.method = Method::Alg4(Core::PseudoInverse { rcond: 0.01 });
    let config: crate::bake::BakeConfig = serde_json::from_value(json(&by_svd)).unwrap();
    assert_eq!(config, by_svd.config);
}

#[test]
fn a_bake_that_was_stopped_before_its_first_block_is_in_the_way_of_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.transport.part");
    let (header, blocks) = part_of_fixture(&path);
    let mut finer = header.clone();
    finer.config.spp *= 2;
    let open = || Part::open(&path, finer.clone(), Restart::Resume);
    assert!(matches!(open(), Err(ArchiveError::OtherBake { .. })));
    fs::write(&path, header_bytes(b"CLERPAR2", &header, Blocks::Plain)).unwrap();
    let (mut part, done) = open().unwrap();
    assert!(done.is_empty());
    part.append(0, &blocks[0]).unwrap();
    drop(part);
    let (_, done) = open().unwrap();
    assert_eq!(done, [(0, blocks[0].clone())]);
}

#[test]
fn a_half_done_bake_is_taken_up_whatever_another_machine_reckons_of_unlit_surfaces() {
    use crate::basis::SourceKind;
    let folder = tempfile::tempdir().unwrap();
    let (mut header, _) = part_of_fixture(&folder.path().join("a.transport.part"));
    let source = &mut header.basis.sources[0];
    (source.kind, source.strength) = (SourceKind::Constant, 64.0);
    let of = |kind: SourceKind, strength: f32| {
        let mut header = header.clone();
        (header.basis.sources[0].kind, header.basis.sources[0].strength) = (kind, strength);
        header
    };
    assert_eq!(part::difference(&header, &of(SourceKind::Constant, 65.0)), None);
    let said = part::difference(&of(SourceKind::Emitter, 64.0), &of(SourceKind::Emitter, 65.0));
    assert_eq!(said.as_deref(), Some("its lights differ"));
}

#[test]
fn a_half_done_bake_of_another_version_of_the_program_is_not_taken_up() {
    let folder = tempfile::tempdir().unwrap();
    let (header, _) = part_of_fixture(&folder.path().join("a.transport.part"));
    let of = |settings: &str| {
        let [surfaces, view] = ["surfaces", "view"].map(String::from);
        let grounds = Grounds { surfaces, seen: None, view, settings: settings.into(), lights: Vec::new() };
        BakeHeader { grounds: Some(grounds), ..header.clone() }
    };
    assert_eq!(part::difference(&of("these"), &of("these")), None);
    let said = part::difference(&of("those"), &of("these"));
    assert_eq!(said.as_deref(), Some("another version of the program began it"));
    // Files of before say nothing of it.
    assert_eq!(part::difference(&header, &header), None);
}

#[test]
fn a_half_done_bake_of_pictures_tells_which_program_began_it() {
    use clerestory_nystrom::rivals::Method;
    use image::{Rgb, RgbImage};

    use crate::bake::stack::{MEMORY_BYTES, StackJob};
    use crate::import::stack::ImageStack;
    let [pictures, out] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    for nth in 0..2u8 {
        let picture = RgbImage::from_fn(40, 8, |x, y| Rgb([6 * x as u8, 100 * nth, 30 * y as u8]));
        picture.save(pictures.path().join(format!("{nth}.png"))).unwrap();
    }
    let path = out.path().join("a.transport");
    let bake = |stops: bool| {
        let stack = Arc::new(ImageStack::open(pictures.path()).unwrap());
        let (method, memory_bytes) = (Method::default(), MEMORY_BYTES);
        let job = StackJob { stack, tolerance_db: 40.0, method, block: 16, seed: 0, memory_bytes };
        let surveyed = job.survey(&mut |_: BakeEvent| ControlFlow::Continue(())).unwrap().unwrap();
        let on_event = |event: BakeEvent| match event {
            BakeEvent::BlockDone { .. } if stops => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        };
        stack_to_file(surveyed, &path, Restart::Resume, on_event).unwrap()
    };
    assert!(bake(true).is_none());
    let bytes = fs::read(part_of(&path)).unwrap();
    let (header, ..) = part::understood(&bytes, &path).unwrap().expect("a block was kept");
    let mut other = header.clone();
    other.grounds.as_mut().expect("it tells its program").settings = "those".into();
    let said = part::difference(&other, &header);
    assert_eq!(said.as_deref(), Some("another version of the program began it"));
    // The bake itself rests on no surfaces.
    assert_eq!(bake(false).expect("nobody stops it").header.grounds, None);
}

#[test]
fn a_half_done_bake_that_differs_by_what_it_took_over_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (header, _) = part_of_fixture(&folder.path().join("a.transport.part"));
    // A bake knows its bias at its end alone.
    let of = |sharing_bias: Option<f32>| BakeHeader { sharing_bias, ..header.clone() };
    let said = part::difference(&of(Some(1e-5)), &of(None));
    assert_eq!(said.as_deref(), Some(part::TAKEN_OVER));
}
