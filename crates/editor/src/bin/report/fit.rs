//! What a few measured points say: where a curve crosses a target, how steeply something grows, how far repeats lie apart.

/// Seconds at which an error is reached, between the two points around it, dB over the logarithm of time; points are
/// (seconds, dB), or have another number above zero instead of seconds. `None` if the first point is beyond it already, whatever the
/// next ones fall back to, or no two neighbors lie on both sides.
pub fn secs_at(target_db: f64, points: &[[f64; 2]]) -> Option<f64> {
    points.first().filter(|[_, db]| *db <= target_db)?;
    let between = points.windows(2).find(|pair| pair[0][1] <= target_db && target_db <= pair[1][1])?;
    let [[from, low], [to, high]] = [between[0], between[1]];
    Some((from.ln() + (to / from).ln() * (target_db - low) / (high - low).max(f64::MIN_POSITIVE)).exp())
}

/// The least and the greatest seconds that it can take: also where the curve begins above the target, or ends below it.
pub fn secs_between(target_db: f64, points: &[[f64; 2]]) -> Option<[f64; 2]> {
    match (secs_at(target_db, points), points.first()?, points.last()?) {
        (Some(secs), ..) => Some([secs; 2]),
        (None, [secs, db], _) if *db >= target_db => Some([0.0, *secs]),
        (None, _, [secs, _]) => Some([*secs, f64::INFINITY]),
    }
}

/// The same in words; “—” of no points.
pub fn secs_words(target_db: f64, points: &[[f64; 2]]) -> String {
    match secs_between(target_db, points) {
        Some([least, greatest]) if greatest.is_infinite() => format!("> {}", digits(least)),
        Some([0.0, greatest]) => format!("< {}", digits(greatest)),
        Some([secs, _]) => digits(secs),
        None => "—".into(),
    }
}

/// Two digits that count.
pub fn digits(value: f64) -> String {
    // What rounds to a tenfold has the digits of that.
    match format!("{value:.1e}").parse().unwrap_or(value) {
        size if size > 0.0 && size < 0.1 => format!("{value:.*}", (1.0 - f64::log10(size).floor()).min(9.0) as usize),
        size if size >= 10.0 => format!("{value:.0}"),
        size if size >= 1.0 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

/// The exponent e of the power law y ∝ xᵉ that fits points (x, y) best, by least squares of the logarithms; `None` for fewer
/// than two different x above zero.
pub fn exponent(points: &[[f64; 2]]) -> Option<f64> {
    let logs: Vec<[f64; 2]> = points.iter().filter(|p| p[0] > 0.0 && p[1] > 0.0).map(|p| p.map(f64::ln)).collect();
    let n = logs.len() as f64;
    let [mean_x, mean_y] = [0, 1].map(|axis| logs.iter().map(|p| p[axis]).sum::<f64>() / n);
    let products: f64 = logs.iter().map(|p| (p[0] - mean_x) * (p[1] - mean_y)).sum();
    let squares: f64 = logs.iter().map(|p| (p[0] - mean_x).powi(2)).sum();
    (squares > 0.0).then(|| products / squares)
}

/// The middle value, or the mean of both in the middle; `None` of nothing.
pub fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (upper, lower) = (sorted.get(sorted.len() / 2)?, sorted.get((sorted.len() - 1) / 2)?);
    Some(0.5 * (lower + upper))
}

/// To a tenth, as dB are told; what is less than half of one is nothing, without a sign.
pub fn to_tenths(db: f64) -> f64 {
    let tenths = (10.0 * db).round();
    if tenths == 0.0 { 0.0 } else { tenths / 10.0 }
}

/// Least, median and greatest of some repeats; none is a number of nothing.
pub fn spread(values: &[f64]) -> [f64; 3] {
    let ends = [f64::min, f64::max].map(|end| values.iter().copied().fold(f64::NAN, end));
    [ends[0], median(values).unwrap_or(f64::NAN), ends[1]]
}

/// The median, and how far repeats lie apart.
pub fn spread_words(values: Vec<f64>) -> String {
    spread_told(values, digits)
}

/// The same with one digit behind the point, as dB are told.
pub fn tenths(values: Vec<f64>) -> String {
    spread_told(values, |value| format!("{value:.1}"))
}

/// The same of repeats some of which may have no figure; “—” where one has none.
pub fn tenths_known(values: &[Option<f64>]) -> String {
    values.iter().copied().collect::<Option<Vec<f64>>>().map_or("—".into(), tenths)
}

/// The same with two digits behind the point, as ratios near one are told.
pub fn hundredths(values: Vec<f64>) -> String {
    spread_told(values, |value| format!("{value:.2}"))
}

/// The same in whole numbers.
pub fn wholes(values: Vec<f64>) -> String {
    spread_told(values, |value| format!("{value:.0}"))
}

/// The same of CPU seconds, which are counted in hundredths.
pub fn cpu_words(values: Vec<f64>) -> String {
    spread_told(values, |secs| match secs {
        secs if secs < 0.005 => "< 0.01".into(),
        secs if secs < 1.0 => format!("{secs:.2}"),
        secs => digits(secs),
    })
}

/// Seeds in words.
pub fn listed(seeds: &[u64]) -> String {
    seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
}

fn spread_told(values: Vec<f64>, tell: fn(f64) -> String) -> String {
    let n = values.len();
    let [least, median, greatest] = spread(&values).map(tell);
    if n > 1 { format!("{median} ({least}…{greatest})") } else { median }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_lies_between_the_points_around_it() {
        let curve = [[1.0, 20.0], [4.0, 40.0], [16.0, 50.0]];
        assert!((secs_at(30.0, &curve).expect("between") - 2.0).abs() < 1e-12);
        assert_eq!([10.0, 30.0, 60.0].map(|db| secs_words(db, &curve)), ["< 1.0", "2.0", "> 16"]);
        assert_eq!(secs_words(10.0, &[]), "—");
        let between = [10.0, 60.0].map(|db| secs_between(db, &curve).expect("points"));
        assert_eq!(between, [[0.0, 1.0], [16.0, f64::INFINITY]]);
        // A preview may be nearer than the few samples behind it.
        let falling = [[1.0, 35.0], [2.0, 29.0], [4.0, 40.0]];
        assert_eq!((secs_at(30.0, &falling), secs_words(30.0, &falling)), (None, "< 1.0".into()));
    }

    #[test]
    fn a_power_law_has_its_exponent_and_one_point_has_none() {
        let points: Vec<[f64; 2]> = (1..6).map(|x| [f64::from(x), 3.0 * f64::from(x).powf(1.5)]).collect();
        assert!((exponent(&points).expect("a line") - 1.5).abs() < 1e-12);
        assert_eq!(exponent(&points[..1]), None);
    }

    #[test]
    fn repeats_are_told_by_their_middle_and_ends() {
        assert_eq!(spread_words(vec![3.0, 1.0, 2.0]), "2.0 (1.0…3.0)");
        assert_eq!(spread_words(vec![0.125]), "0.12");
        assert_eq!(tenths_known(&[Some(30.0), Some(31.0)]), "30.5 (30.0…31.0)");
        assert_eq!(tenths_known(&[Some(30.0), None]), "—");
        assert_eq!(wholes(vec![3.0, 1204.4, 20.0]), "20 (3…1204)");
        assert_eq!([vec![0.0, 0.06, 0.07], vec![21.3]].map(cpu_words), ["0.06 (< 0.01…0.07)", "21"]);
        assert_eq!(
            [0.0, 0.0042, 0.081, 0.25, 1.25, 12.5].map(digits),
            ["0.00", "0.0042", "0.081", "0.25", "1.2", "12"]
        );
        assert_eq!([0.000_999_7, 0.0997, 0.9996, 9.97].map(digits), ["0.0010", "0.10", "1.0", "10"]);
    }

    #[test]
    fn less_than_half_a_tenth_has_no_sign() {
        assert_eq!(
            [-0.04, 0.04, -0.06, 1.26].map(|db| format!("{:+.1}", to_tenths(db))),
            ["+0.0", "+0.0", "-0.1", "+1.3"]
        );
    }

    #[test]
    fn a_median_is_the_middle_or_the_mean_of_both() {
        assert_eq!(
            [&[][..], &[3.0], &[4.0, 1.0, 2.0], &[9.0, 1.0, 2.0, 4.0]].map(median),
            [None, Some(3.0), Some(2.0), Some(3.0)]
        );
    }
}
