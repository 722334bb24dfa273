//! Stability: every method on every matrix of the stress suite, in single and in double precision.

mod answer;

use anyhow::Result;
use clerestory_nystrom::Selection;
use clerestory_nystrom::rivals::{Core, Method};
use clerestory_nystrom::stress::{ASKED, Case, cases, condition, ours, refused, rival};

use super::desk::Desk;
use answer::{Answer, Measured, figure, refusal};

/// Of the cases and of the methods.
const SEED: u64 = 1;
/// Tables, and the algorithm whose cores stand in each; in the last one what takes no core.
const TABLES: [(&str, Option<Selection>); 6] = [
    ("Algorithm 1: random rows, columns by k-means", Some(Selection::Alg1)),
    ("Algorithm 2: random columns, rows by k-means", Some(Selection::Alg2)),
    ("Algorithm 3: random rows and columns", Some(Selection::Alg3)),
    ("Algorithm 4: rows and columns by k-means in turn", Some(Selection::Alg4)),
    ("Algorithm 4 with the columns of both rounds, half of them random", Some(Selection::Alg4Union)),
    ("Other methods", None),
];

/// In a hurry every so manyth of the cases without large matrices, and of the methods: few of each kind.
const HURRY_STEPS: [usize; 2] = [5, 2];
/// Entries of a matrix that is not large.
const FEW_ENTRIES: usize = 10_000;

/// Runs every method on every case, in a hurry some of both.
///
/// # Errors
/// If our own method has no answer to one of them.
pub fn write(desk: &Desk) -> Result<String> {
    desk.say("compressing the cases of the stress suite");
    let of_suite: fn() -> Vec<Case> = desk.choose(few_cases, || cases(SEED));
    let of_methods = desk.choose(HURRY_STEPS[1], 1);
    let measured = of_suite().into_iter().map(Measured::new).collect::<Result<Vec<_>>>()?;
    let mut answers: Vec<(Method, Vec<[Answer; 2]>)> = Vec::new();
    for method in Method::every().step_by(of_methods) {
        let both = |measured: &Measured| [measured.rival::<f32>(method), measured.rival::<f64>(method)];
        // Names of files hold no colon everywhere.
        let of_cases: Vec<[Answer; 2]> = desk.part("stability", &method.to_string().replace(':', "-"), || {
            desk.say(&format!("running {method}"));
            Ok(measured.iter().map(both).collect())
        })?;
        answers.push((method, of_cases));
    }
    let mut text = own_table(&measured);
    text += &baked_table(&measured);
    text += &summary(&measured, &answers);
    text += &refusals();
    for (title, selection) in TABLES {
        let of_table = answers.iter().filter(|(method, _)| selection_of(*method) == selection);
        text += &table(title, selection, &measured, &of_table.collect::<Vec<_>>());
    }
    let few = desk
        .choose("In a hurry: every fifth of the cases without large matrices, and every other method, alone.\n\n", "");
    // Last, as it tells how long all of it took.
    Ok(format!("{}\n\n{few}{text}", desk.provenance("stability")?))
}

/// What is run in a hurry.
fn few_cases() -> Vec<Case> {
    let small = cases(SEED).into_iter().filter(|case| case.truth.len() <= FEW_ENTRIES);
    small.step_by(HURRY_STEPS[0]).collect()
}

/// The algorithm whose intersection W a method has; `None` if it has none.
fn selection_of(method: Method) -> Option<Selection> {
    match method {
        Method::Alg1(_) => Some(Selection::Alg1),
        Method::Alg2(_) => Some(Selection::Alg2),
        Method::Alg3(_) => Some(Selection::Alg3),
        Method::Alg4(_) => Some(Selection::Alg4),
        Method::Alg4Union(_) => Some(Selection::Alg4Union),
        _ => None,
    }
}

fn core_of(method: Method) -> Option<Core> {
    match method {
        Method::Alg1(core) | Method::Alg2(core) | Method::Alg3(core) | Method::Alg4(core) | Method::Alg4Union(core) => {
            Some(core)
        }
        _ => None,
    }
}

fn own_table(measured: &[Measured]) -> String {
    let mut text = format!(
        "## Ours\n\n\
         Cases and methods of seed {SEED}. Shares of the norm. *Allowed* is twice the optimum and 1e-6; *packed* has the rounding of stored factors on top.\n\
         The optimum is in double precision. Ours computes in single precision whatever it is given, as samples come so (sums, Gram matrices and eigenvalues\n\
         in double), so `projected` among all methods gives the same figure twice.\n\n\
         | case | rows × columns | rank asked for / kept | optimum | error | allowed | over the optimum | told by the halves | packed |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for of_case in measured {
        let Measured { case, optimum, ours, .. } = of_case;
        let norm = case.norm();
        let [optimum, error, allowed, told, packed] =
            [*optimum, ours.error, case.allowed_beside(*optimum), ours.told, ours.packed_error].map(|x| share(x, norm));
        text += &format!(
            "| {} | {} × {} | {} / {} | {optimum} | {error} | {allowed} | {} | {told} | {packed} |\n",
            case.name,
            case.truth.nrows(),
            case.truth.ncols(),
            case.rank,
            ours.rank,
            of_case.answer(ours.error).words(),
        );
    }
    text
}

/// The same cases by all that a bake does.
fn baked_table(measured: &[Measured]) -> String {
    let mut text = format!(
        "\n## Ours, as a bake goes\n\n\
         Shares of the norm; {ASKED:.1e} is asked for. *Sampled* is what the mean of both halves is off by, *error* what the factors are, *added* what\n\
         packing says that it adds.\n\n\
         | case | rank | sampled | error | told by the halves | denoised | unpacked | added | bytes |\n\
         |---|---|---|---|---|---|---|---|---|\n"
    );
    for Measured { case, stored, .. } in measured {
        let steps =
            [case.distance(&case.mean()), stored.error, stored.told, stored.denoised, stored.unpacked, stored.added];
        let [sampled, error, told, denoised, unpacked, added] = steps.map(|x| share(x, case.norm()));
        text += &format!(
            "| {} | {} | {sampled} | {error} | {told} | {denoised} | {unpacked} | {added} | {} |\n",
            case.name, stored.rank, stored.n_bytes
        );
    }
    text
}

fn share(distance: f64, norm: f64) -> String {
    if distance == 0.0 { "0".into() } else { format!("{:.1e}", distance / norm) }
}

fn summary(measured: &[Measured], answers: &[(Method, Vec<[Answer; 2]>)]) -> String {
    let mut text = format!(
        "\n## All methods\n\n\
         Of {} cases: how many are within twice the optimum and 1e-6 of the norm, the median of the error over the optimum, and the\n\
         worst; in single / double precision. The cases, and what methods choose by chance, are of seed {SEED} alone: how far other seeds lie apart is not measured here.\n\n\
         | method | within the bound | median | worst | where |\n|---|---|---|---|---|\n",
        measured.len()
    );
    let own: Vec<Answer> = measured.iter().map(|measured| measured.answer(measured.ours.error)).collect();
    let names: Vec<&str> = measured.iter().map(|measured| measured.case.name).collect();
    let (within, median, worst, at) = summed(&own, &names);
    text += &format!("| **ours, before packing** (both halves) | {within} | {median} | {worst} | {at} |\n");
    for (method, of_cases) in answers {
        let [single, double] = [0, 1].map(|precision| {
            let one: Vec<Answer> = of_cases.iter().map(|both| both[precision]).collect();
            summed(&one, &names)
        });
        text += &format!(
            "| {method} | {} / {} | {} / {} | {} / {} | {} / {} |\n",
            single.0, double.0, single.1, double.1, single.2, double.2, single.3, double.3
        );
    }
    text
}

/// How many are within the bound, the median, the worst, and the case of the worst.
fn summed(answers: &[Answer], names: &[&str]) -> (usize, String, String, String) {
    let within = answers.iter().filter(|answer| answer.is_within()).count();
    let mut order: Vec<usize> = (0..answers.len()).collect();
    order.sort_by(|&i, &j| answers[i].ratio().total_cmp(&answers[j].ratio()));
    let [lower, upper, last] = [(order.len() - 1) / 2, order.len() / 2, order.len() - 1].map(|nth| order[nth]);
    (within, middle(answers[lower], answers[upper]), answers[last].words(), names[last].into())
}

/// The median given what lies on both sides of it, which is one answer twice where there is a middle one; no answer is worse than any.
fn middle(lower: Answer, upper: Answer) -> String {
    match (lower, upper) {
        (Answer::Error { ratio: low, .. }, Answer::Error { ratio: high, .. }) => figure(0.5 * (low + high)),
        _ => upper.words(),
    }
}

/// Entries that are no numbers: who names them.
fn refusals() -> String {
    let odd = refused(SEED);
    let refused = |method: Method| {
        odd.iter().all(|(case, _)| {
            let both = [rival::<f32>(case, method, SEED), rival::<f64>(case, method, SEED)];
            both.iter().all(|answer| answer.as_ref().is_err_and(|error| matches!(refusal(error), Answer::Refused)))
        })
    };
    let (refusing, others): (Vec<Method>, Vec<Method>) = Method::every().partition(|method| refused(*method));
    let ours = odd.iter().map(|(case, _)| ours(case).map_or_else(|error| format!("“{error}”"), |_| "nothing".into()));
    let others: Vec<String> = others.iter().map(Method::to_string).collect();
    format!(
        "\n## Entries that are no numbers\n\n\
         Not a number, infinity and minus infinity, one in a case, are refused by {} of {} methods{}. Of samples ours says:\n\n- {}\n",
        refusing.len(),
        Method::every().count(),
        if others.is_empty() { String::new() } else { format!(", not by {}", others.join(", ")) },
        ours.collect::<Vec<_>>().join("\n- "),
    )
}

fn table(
    title: &str,
    selection: Option<Selection>,
    measured: &[Measured],
    answers: &[&(Method, Vec<[Answer; 2]>)],
) -> String {
    let mut text = format!("\n## {title}\n\n| case |");
    if selection.is_some() {
        text += " cond(W) |";
    }
    for (method, _) in answers {
        let name = core_of(*method).map_or_else(|| method.to_string(), |core| core.to_string());
        text += &format!(" {name} |");
    }
    text += &format!("\n|{}\n", "---|".repeat(answers.len() + 1 + usize::from(selection.is_some())));
    for (i, Measured { case, .. }) in measured.iter().enumerate() {
        text += &format!("| {} |", case.name);
        if let Some(selection) = selection {
            text += &format!(" {} |", figure(condition(case, selection, SEED)));
        }
        for (_, of_cases) in answers {
            let [single, double] = of_cases[i].map(Answer::words);
            text += &if single == double { format!(" {single} |") } else { format!(" {single} / {double} |") };
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_stands_in_one_table_by_its_core_if_it_takes_one() {
        for method in Method::every() {
            let selection = selection_of(method);
            assert_eq!(TABLES.iter().filter(|(_, of_table)| *of_table == selection).count(), 1, "{method}");
            assert_eq!(selection.is_none(), method.is_by_itself(), "{method}");
            assert_eq!(core_of(method).is_none(), method.is_by_itself(), "{method}");
        }
    }

    #[test]
    fn the_median_of_an_even_number_of_cases_is_the_mean_of_both_in_the_middle() {
        let error = |ratio: f64| Answer::Error { ratio, is_within: ratio <= 2.0 };
        let names = ["a", "b", "c", "d"];
        let told = summed(&[error(1.0), error(4.0), error(2.0), error(9.0)], &names);
        assert_eq!(told, (2, "3.00".into(), "9.00".into(), "d".into()));
        let told = summed(&[error(1.0), error(4.0), error(2.0)], &names[..3]);
        assert_eq!(told, (2, "2.00".into(), "4.00".into(), "b".into()));
        let told = summed(&[error(1.0), Answer::Singular, error(2.0), Answer::Singular], &names);
        assert_eq!((told.0, told.1.as_str()), (2, "singular"));
    }

    #[test]
    fn in_a_hurry_there_is_a_method_of_each_table_and_no_large_matrix() {
        let methods: Vec<Method> = Method::every().step_by(HURRY_STEPS[1]).collect();
        for (_, selection) in TABLES {
            assert!(methods.iter().any(|method| selection_of(*method) == selection), "{selection:?}");
        }
        let few = few_cases();
        assert!((5..=10).contains(&few.len()), "{}", few.len());
        assert!(few.iter().all(|case| case.truth.len() <= FEW_ENTRIES));
    }
}
