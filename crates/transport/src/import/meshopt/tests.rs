use super::attributes::read_group;
use super::*;

/// 64-bit linear congruential generator.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as u32
    }
}

fn view(mode: &str, filter: &str, count: usize, stride: usize, n_bytes: usize) -> Compressed {
    let json = format!(
        r#"{{"buffer": 0, "byteLength": {n_bytes}, "byteStride": {stride}, "count": {count}, "mode": "{mode}", "filter": "{filter}"}}"#
    );
    Compressed::checked(serde_json::from_str(&json).expect("a view")).expect("a sound view")
}

/// Sixteen differences in so many bits.
fn write_group(values: &[u8], bits: u32, out: &mut Vec<u8>) {
    let mut values = values.to_vec();
    values.resize(16, 0);
    if bits == 8 {
        return out.extend(values);
    }
    let sentinel = (1_u8 << bits) - 1;
    for packed in values.chunks(8 / bits as usize) {
        let place = |nth: u32| if bits == 1 { nth } else { 8 - bits * (nth + 1) };
        out.push((0..).zip(packed).fold(0, |byte, (nth, &value)| byte | value.min(sentinel) << place(nth)));
    }
    out.extend(values.iter().filter(|&&value| value >= sentinel));
}

/// Whether a group of so many bits can hold the values: with none only zeros.
fn fits(values: &[u8], bits: u32) -> bool {
    bits > 0 || values.iter().all(|&value| value == 0)
}

/// Codes of one byte position of a block: headers and groups.
fn write_position(codes: &[u8], bits: [u32; 4], dice: &mut Dice, out: &mut Vec<u8>) {
    let choices: Vec<usize> = codes
        .chunks(16)
        .map(|group| {
            let possible: Vec<usize> = (0..4).filter(|&i| fits(group, bits[i])).collect();
            possible[dice.next() as usize % possible.len()]
        })
        .collect();
    out.extend(
        choices.chunks(4).map(|four| (0..).zip(four).fold(0, |byte, (i, &choice)| byte | (choice as u8) << (2 * i))),
    );
    codes.chunks(16).zip(choices).filter(|(_, choice)| bits[*choice] > 0).for_each(|(group, choice)| {
        write_group(group, bits[choice], out);
    });
}

fn zigzag(value: u32, bits: u32) -> u32 {
    let sign = value >> (bits - 1) & 1;
    let mask = u32::MAX >> (32 - bits);
    ((value << 1) ^ sign.wrapping_neg()) & mask
}

/// Differences of four bytes in a channel mode.
fn difference(before: [u8; 4], now: [u8; 4], mode: u8) -> [u8; 4] {
    match mode & 15 {
        0 => std::array::from_fn(|i| zigzag(u32::from(now[i].wrapping_sub(before[i])), 8) as u8),
        1 => {
            let half = |bytes: [u8; 4], i: usize| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]);
            let code = |i: usize| zigzag(u32::from(half(now, i).wrapping_sub(half(before, i))), 16) as u16;
            let (low, high) = (code(0).to_le_bytes(), code(1).to_le_bytes());
            [low[0], low[1], high[0], high[1]]
        }
        _ => (u32::from_le_bytes(now) ^ u32::from_le_bytes(before)).rotate_left(u32::from(mode >> 4)).to_le_bytes(),
    }
}

/// A stream that decodes to some elements, with every choice that an encoder has made at random.
fn encode(elements: &[u8], stride: usize, version: u8, dice: &mut Dice) -> Vec<u8> {
    let modes: Vec<u8> = (0..stride / 4)
        .map(|_| match dice.next() % 3 {
            _ if version == 0 => 0,
            2 => ((dice.next() % 16) << 4) as u8 | 2,
            mode => mode as u8,
        })
        .collect();
    let mut last: Vec<u8> = (0..stride).map(|_| dice.next() as u8).collect();
    let baseline = last.clone();
    let mut out = vec![0xA0 | version];
    for block in elements.chunks(stride * (8192 / stride / 16 * 16).min(256)) {
        let mut codes = Vec::new();
        for element in block.chunks(stride) {
            for (channel, &mode) in modes.iter().enumerate() {
                let four = |bytes: &[u8]| bytes[4 * channel..][..4].try_into().expect("four bytes");
                codes.extend(difference(four(&last), four(element), mode));
            }
            last.copy_from_slice(element);
        }
        let position = |at: usize| codes.iter().skip(at).step_by(stride).copied().collect::<Vec<u8>>();
        let mut controls = vec![0_u8; stride / 4];
        let mut body = Vec::new();
        for at in 0..stride {
            let codes = position(at);
            let control = if codes.iter().all(|&code| code == 0) { 2 } else { [0, 1, 3][dice.next() as usize % 3] };
            controls[at / 4] |= control << (2 * (at % 4));
            match (version, control) {
                (0, _) => write_position(&codes, [0, 2, 4, 8], dice, &mut body),
                (_, 0) => write_position(&codes, [0, 1, 2, 4], dice, &mut body),
                (_, 1) => write_position(&codes, [1, 2, 4, 8], dice, &mut body),
                (_, 3) => body.extend(codes),
                _ => {}
            }
        }
        if version == 1 {
            out.extend(controls);
        }
        out.extend(body);
    }
    let mut tail = baseline;
    if version == 1 {
        tail.extend(modes);
    }
    out.resize(out.len() + [32, 24][usize::from(version)].max(tail.len()) - tail.len(), 0);
    out.extend(tail);
    out
}

/// Elements that differ a little, a lot, or not at all, from byte to byte.
fn elements(count: usize, stride: usize, dice: &mut Dice) -> Vec<u8> {
    let masks: Vec<u32> = (0..stride).map(|_| [0, 1, 3, 15, 255][dice.next() as usize % 5]).collect();
    let mut now = vec![0_u8; stride];
    (0..count)
        .flat_map(|_| {
            now.iter_mut().zip(&masks).for_each(|(byte, mask)| *byte = byte.wrapping_add((dice.next() & mask) as u8));
            now.clone()
        })
        .collect()
}

#[test]
fn attributes_decode_to_what_was_encoded() {
    let mut dice = Dice(1);
    for (count, stride) in [(1, 4), (16, 8), (17, 12), (300, 4), (1000, 16), (95, 256), (700, 20)] {
        for version in [0, 1] {
            let elements = elements(count, stride, &mut dice);
            let stream = encode(&elements, stride, version, &mut dice);
            let decoded = view("ATTRIBUTES", "NONE", count, stride, stream.len()).decode(&stream);
            assert!(decoded.as_ref() == Ok(&elements), "{count} of {stride} bytes, version {version}: {decoded:?}");
        }
    }
}

#[test]
fn the_group_of_the_specification_decodes() {
    let bytes = [0x17, 0x5F, 0xF0, 0xBC, 0x77, 0xA9, 0x21, 0x00, 0x34, 0xB5];
    let codes = read_group(&mut Stream { rest: &bytes }, 4).expect("a whole group");
    let differences = codes.map(|code| unzigzag(u32::from(code)) as i8);
    assert_eq!(differences, [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0]);
}

#[test]
fn triangles_decode_as_the_specification_tells() {
    // Three new corners, a new corner on the second newest edge, three told ones, three new ones, the newest edge with the
    // corner after the last told one, the newest edge with the third newest corner, a restart.
    let codes = [0xF0, 0x10, 0xFF, 0xF0, 0x0E, 0x02, 0xFE];
    let extra = [0xFF, 8, 4, 1, 0x00];
    let stream = [&[0xE1][..], &codes, &extra, &[0; 16]].concat();
    let expected = [[0, 1, 2], [2, 1, 3], [4, 6, 5], [4, 5, 6], [4, 6, 6], [4, 6, 5], [0, 1, 2]];
    let expected: Vec<u8> = expected.iter().flatten().flat_map(|&index: &u16| index.to_le_bytes()).collect();
    assert_eq!(view("TRIANGLES", "NONE", 21, 2, stream.len()).decode(&stream), Ok(expected));
    let refused = |change: fn(&mut Vec<u8>), reason: &str| {
        let mut stream = stream.clone();
        change(&mut stream);
        let error = view("TRIANGLES", "NONE", 21, 2, stream.len()).decode(&stream).expect_err(reason);
        assert!(error.contains(reason), "{error}");
    };
    refused(|stream| stream[1] = 0x00, "was not there yet");
    refused(|stream| stream.insert(13, 0), "too many");
    refused(|stream| stream[0] = 0xE0, "no stream of triangles");
    refused(|stream| *stream.last_mut().expect("a tail") = 1, "table");
    refused(|stream| stream.truncate(12), "too early");
}

#[test]
fn indices_decode_to_what_was_encoded() {
    let mut dice = Dice(3);
    let indices: Vec<u32> = (0..400).map(|i| i * 5 + dice.next() % 90 + (i % 2) * 100_000).collect();
    let mut last = [0_u32; 2];
    let mut stream = vec![0xD1];
    for &index in &indices {
        let baseline = usize::from(index >= 100_000);
        let mut code = zigzag(index.wrapping_sub(last[baseline]), 31) << 1 | baseline as u32;
        last[baseline] = index;
        while code >= 0x80 {
            stream.push(code as u8 | 0x80);
            code >>= 7;
        }
        stream.push(code as u8);
    }
    stream.extend([0; 4]);
    for stride in [4, 2] {
        let expected: Vec<u8> = indices.iter().flat_map(|index| index.to_le_bytes()[..stride].to_vec()).collect();
        assert_eq!(view("INDICES", "NONE", 400, stride, stream.len()).decode(&stream), Ok(expected));
    }
}

#[test]
fn filters_give_values_known_by_hand() {
    let mut unit = [0_i8, 127, 127, 5, -32, -32, 64, 7, 0, 0, 7, 1, -63, 0, 63, 0].map(|v| v as u8);
    filters::octahedral(&mut unit, 4);
    assert_eq!(unit.map(|v| v as i8), [0, 127, 0, 5, -90, -90, 0, 7, 0, 0, 127, 1, -127, 0, 0, 0]);
    let mut down: Vec<u8> = [1023_i16, 1023, 1023, -9].iter().flat_map(|v| v.to_le_bytes()).collect();
    filters::octahedral(&mut down, 8);
    assert_eq!(down, [0_i16, 0, -32767, -9].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    let mut turn: Vec<u8> = [0_i16, 0, 2047, 2044 | 1].iter().flat_map(|v| v.to_le_bytes()).collect();
    filters::quaternion(&mut turn);
    let half = 23170_i16;
    assert_eq!(turn, [half, half, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    let mut number = ((-3_i32) << 24 | 0xFF_FFF4).to_le_bytes();
    filters::exponential(&mut number);
    assert_eq!(f32::from_le_bytes(number), -1.5);
    // K = 8: y = 100, co = 50, cg = −20, alpha 0x7F of 7 bits: r = 170, g = 80, b = 70.
    let mut color = [100, 50, (-20_i8) as u8, 0xFF];
    filters::color(&mut color, 4);
    assert_eq!(color, [170, 80, 70, 255]);
}

#[test]
fn views_that_cannot_be_are_refused_before_memory_is_asked_for() {
    let accepted = |mode: &str, filter: &str, count: usize, stride: usize| {
        let json = format!(
            r#"{{"buffer": 0, "byteLength": 64, "byteStride": {stride}, "count": {count}, "mode": "{mode}", "filter": "{filter}"}}"#
        );
        serde_json::from_str(&json).is_ok_and(|view| Compressed::checked(view).is_ok())
    };
    assert!(accepted("ATTRIBUTES", "NONE", 16, 4));
    for (mode, filter, count, stride) in [
        ("ATTRIBUTES", "NONE", 16, 6),
        ("ATTRIBUTES", "NONE", 16, 260),
        ("ATTRIBUTES", "NONE", 16, 0),
        ("ATTRIBUTES", "QUATERNION", 16, 4),
        ("ATTRIBUTES", "OCTAHEDRAL", 16, 12),
        ("ATTRIBUTES", "NONE", 1 << 40, 4),
        ("ATTRIBUTES", "NONE", usize::MAX, 256),
        ("TRIANGLES", "NONE", 16, 4),
        ("TRIANGLES", "OCTAHEDRAL", 15, 4),
        ("INDICES", "NONE", 16, 8),
        ("VIDEO", "NONE", 16, 4),
    ] {
        assert!(!accepted(mode, filter, count, stride), "{mode} {filter} {count} {stride}");
    }
}

#[test]
fn damaged_streams_never_panic() {
    let mut dice = Dice(5);
    let elements = elements(150, 16, &mut dice);
    let streams = [0, 1].map(|version| encode(&elements, 16, version, &mut dice));
    let triangles = [&[0xE1, 0xF0, 0x10, 0xFF, 0xF0, 0x0E, 0x02, 0xFE, 0xFF, 8, 4, 1, 0x00][..], &[0; 16]].concat();
    let mut n_refused = 0;
    for nth in 0..3000 {
        let (mode, filter, count, stride, stream) = match nth % 4 {
            0 => ("ATTRIBUTES", "NONE", 150, 16, &streams[0]),
            1 => ("ATTRIBUTES", "EXPONENTIAL", 150, 16, &streams[1]),
            2 => ("TRIANGLES", "NONE", 21, 4, &triangles),
            _ => ("INDICES", "NONE", 20, 2, &triangles),
        };
        let mut stream = stream.clone();
        for _ in 0..1 + dice.next() % 3 {
            let at = dice.next() as usize % stream.len();
            stream[at] = dice.next() as u8;
        }
        if dice.next().is_multiple_of(4) {
            stream.truncate(dice.next() as usize % stream.len());
        }
        let decoded = view(mode, filter, count, stride, 4096).decode(&stream);
        n_refused += usize::from(decoded.is_err());
        assert!(decoded.is_err() || decoded.is_ok_and(|bytes| bytes.len() == count * stride));
    }
    assert!(n_refused > 500, "{n_refused} of 3000 were refused");
}
