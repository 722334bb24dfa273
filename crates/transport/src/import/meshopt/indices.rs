//! Modes 1 and 2: indices of triangle lists, and of anything else.

use super::{Stream, unzigzag};

/// The last so many of something, the newest first.
struct Fifo<T> {
    items: [T; 16],
    /// All that were ever pushed.
    n_pushed: usize,
}

impl<T: Copy + Default> Fifo<T> {
    fn new() -> Fifo<T> {
        Fifo { items: [T::default(); 16], n_pushed: 0 }
    }

    #[expect(clippy::arithmetic_side_effects, reason = "a handful for each byte in memory")]
    fn push(&mut self, item: T) {
        self.items[self.n_pushed % 16] = item;
        self.n_pushed += 1;
    }

    #[expect(clippy::arithmetic_side_effects, reason = "the age is below the number pushed")]
    fn get(&self, age: u8) -> Result<T, String> {
        let age = usize::from(age);
        if age >= self.n_pushed.min(16) {
            return Err("its stream refers to what was not there yet".to_owned());
        }
        Ok(self.items[(self.n_pushed - 1 - age) % 16])
    }
}

/// State of the triangle decoder.
struct Triangles<'a> {
    extra: Stream<'a>,
    /// Combinations of the second and third corner that a single code stands for.
    table: &'a [u8],
    edges: Fifo<[u32; 2]>,
    vertices: Fifo<u32>,
    /// The lowest index that was not used yet.
    next: u32,
    /// The last index that was told.
    last: u32,
}

/// `count` indices, a multiple of three, of `stride` bytes, 2 or 4.
pub(super) fn triangles(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, String> {
    const TABLE: usize = 16;
    let body = body_after(stream, 0xE1, "triangles")?;
    let n_body = body.len().checked_sub(TABLE).ok_or("its stream ends too early")?;
    let (body, table) = body.split_at(n_body);
    if table[14..] != [0, 0] || table.iter().any(|pair| pair >> 4 == 15 || pair & 15 == 15) {
        return Err("the table of its stream is broken".to_owned());
    }
    let mut extra = Stream { rest: body };
    let codes = extra.take(count / 3)?;
    let mut state = Triangles { extra, table, edges: Fifo::new(), vertices: Fifo::new(), next: 0, last: 0 };
    #[expect(clippy::arithmetic_side_effects, reason = "`Compressed::checked` has multiplied them")]
    let mut out = Vec::with_capacity(count * stride);
    for &code in codes {
        let corners = if code < 0xF0 { state.on_edge(code) } else { state.apart(code) }?;
        corners.iter().for_each(|corner| out.extend_from_slice(&corner.to_le_bytes()[..stride]));
    }
    state.extra.end()?;
    Ok(out)
}

impl Triangles<'_> {
    /// A triangle on an edge of one before.
    fn on_edge(&mut self, code: u8) -> Result<[u32; 3], String> {
        let [a, b] = self.edges.get(code >> 4)?;
        let c = match code & 15 {
            0 => self.new_vertex(),
            how @ 1..=12 => self.vertices.get(how)?,
            13 => {
                self.last = self.last.wrapping_sub(1);
                self.last
            }
            14 => {
                self.last = self.last.wrapping_add(1);
                self.last
            }
            _ => self.told()?,
        };
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        if !matches!(code & 15, 1..=12) {
            self.vertices.push(c);
        }
        Ok([a, b, c])
    }

    /// A triangle that has no edge with a recent one.
    fn apart(&mut self, code: u8) -> Result<[u32; 3], String> {
        let pair = match code {
            0xF0..=0xFD => self.table[usize::from(code & 15)],
            _ => self.extra.byte()?,
        };
        // The table has the same pair without a restart.
        if pair == 0 && code >= 0xFE {
            self.next = 0;
        }
        let a = if code == 0xFF { self.told()? } else { self.new_vertex() };
        let b = self.corner(pair >> 4)?;
        let c = self.corner(pair & 15)?;
        self.edges.push([b, a]);
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        self.vertices.push(a);
        for (how, vertex) in [(pair >> 4, b), (pair & 15, c)] {
            if matches!(how, 0 | 15) {
                self.vertices.push(vertex);
            }
        }
        Ok([a, b, c])
    }

    #[expect(clippy::arithmetic_side_effects, reason = "ages are from 1 to 14")]
    fn corner(&mut self, how: u8) -> Result<u32, String> {
        match how {
            0 => Ok(self.new_vertex()),
            15 => self.told(),
            age => self.vertices.get(age - 1),
        }
    }

    fn new_vertex(&mut self) -> u32 {
        self.next = self.next.wrapping_add(1);
        self.next.wrapping_sub(1)
    }

    fn told(&mut self) -> Result<u32, String> {
        self.last = self.last.wrapping_add(unzigzag(self.extra.varint()?));
        Ok(self.last)
    }
}

/// `count` indices of `stride` bytes, 2 or 4, as differences from one of two others.
pub(super) fn sequence(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, String> {
    const TAIL: usize = 4;
    let body = body_after(stream, 0xD1, "indices")?;
    let n_body = body.len().checked_sub(TAIL).ok_or("its stream ends too early")?;
    let mut body = Stream { rest: &body[..n_body] };
    if count > n_body {
        return Err("its stream ends too early".to_owned());
    }
    let mut last = [0_u32; 2];
    #[expect(clippy::arithmetic_side_effects, reason = "`Compressed::checked` has multiplied them")]
    let mut out = Vec::with_capacity(count * stride);
    for _ in 0..count {
        let code = body.varint()?;
        let baseline = &mut last[(code & 1) as usize];
        *baseline = baseline.wrapping_add(unzigzag(code >> 1));
        out.extend_from_slice(&baseline.to_le_bytes()[..stride]);
    }
    body.end()?;
    Ok(out)
}

fn body_after<'a>(stream: &'a [u8], header: u8, what: &str) -> Result<&'a [u8], String> {
    match stream.split_first() {
        Some((&first, body)) if first == header => Ok(body),
        Some((first, _)) => Err(format!("its stream begins with {first:#x}, which is no stream of {what}")),
        None => Err("its stream is empty".to_owned()),
    }
}
