use super::*;
use crate::math::random::Purpose;
use crate::math::sampling;
use std::fmt::Write;

fn random(index: u64) -> Stream {
    Stream::new(91, Purpose::Test, index, 0)
}

fn ies(text: &str) -> Result<Profile, String> {
    Profile::parse(text.as_bytes(), false)
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// A file with these angles, and one intensity for each pair of them.
fn file(vertical: &[f64], horizontal: &[f64], intensity: impl Fn(f64, f64) -> f64) -> String {
    let mut text = "IESNA:LM-63-1995\n[TEST] none\nTILT=NONE\n".to_string();
    let (v, h) = (vertical.len(), horizontal.len());
    writeln!(text, "1 1000 2.5 {v} {h} 1 2 0 0 0\n1 1 60").unwrap();
    writeln!(text, "{}\n{}", joined(vertical), joined(horizontal)).unwrap();
    for h in horizontal {
        writeln!(text, "{}", joined(&vertical.iter().map(|v| intensity(*v, *h)).collect::<Vec<_>>())).unwrap();
    }
    text
}

const VERTICAL: [f64; 7] = [0.0, 10.0, 30.0, 31.0, 70.0, 120.0, 180.0];

/// Without symmetry, dark in places, as bright where a measurement ends.
fn odd(v: f64, h: f64) -> f64 {
    if (v - 30.0).abs() < 0.1 && h > 100.0 { 0.0 } else { 10.0 + v * (1.0 + (h * 0.05).sin()) }
}

fn profiles() -> Vec<Profile> {
    let all = [0.0, 40.0, 90.0, 200.0, 270.0, 330.0];
    [
        file(&VERTICAL, &[0.0], odd),
        file(&VERTICAL, &all, odd),
        file(&[0.0, 20.0, 45.0, 90.0], &[0.0, 45.0, 90.0], odd),
        file(&[90.0, 100.0, 160.0], &[0.0, 90.0, 180.0], odd),
        // Lit in one direction only, and a needle.
        file(&[10.0, 60.0, 80.0], &[0.0, 120.0, 240.0], |v, h| if v == 60.0 && h == 120.0 { 1.0 } else { 0.0 }),
        file(&[0.0, 0.5, 180.0], &[0.0], |v, _| if v == 0.0 { 1e6 } else { 1.0 }),
    ]
    .iter()
    .map(|text| ies(text).unwrap())
    .collect()
}

/// The sum is that of the interpolant over all directions, and draws are in proportion to it: χ² over cells of the sphere.
#[test]
fn draws_follow_the_interpolant() {
    const N: usize = 200_000;
    const ROWS: usize = 36;
    const COLUMNS: usize = 24;
    const FINE: usize = 40;
    for (index, profile) in profiles().iter().enumerate() {
        // Cells are even in θ, where needles are: their solid angles differ.
        let mut expected = vec![0.0; ROWS * COLUMNS];
        for (cell, expected) in expected.iter_mut().enumerate() {
            for k in 0..FINE * FINE {
                let place =
                    |cell: usize, fine: usize, n: usize| (cell as f64 + (fine as f64 + 0.5) / FINE as f64) / n as f64;
                // θ by the square of its share: fine about the axis.
                let share = place(cell / COLUMNS, k / FINE, ROWS);
                let (theta, phi) = (PI * share * share, TAU * place(cell % COLUMNS, k % FINE, COLUMNS));
                let area = theta.sin() * 2.0 * PI * share / (ROWS * FINE) as f64 * TAU / (COLUMNS * FINE) as f64;
                *expected += profile.at(sampling::direction(theta.cos(), phi / TAU)) * area;
            }
        }
        let total: f64 = expected.iter().sum();
        assert!((total / profile.total() - 1.0).abs() < 3e-3, "{index}: {total}, not {}", profile.total());

        let mut counts = vec![0.0; ROWS * COLUMNS];
        let mut stream = random(index as u64);
        for _ in 0..N {
            let o = profile.sample(&mut stream);
            assert!(profile.at(o) > 0.0 && (o.length() - 1.0).abs() < 1e-9, "{index}: {o} has no light");
            let theta = o.x.hypot(o.y).atan2(o.z);
            assert!(theta <= profile.widest() + 1e-9, "{index}: {theta} beyond {}", profile.widest());
            let turn = (o.y.atan2(o.x) / TAU).rem_euclid(1.0);
            let row = (((theta / PI).sqrt() * ROWS as f64) as usize).min(ROWS - 1);
            counts[row * COLUMNS + ((turn * COLUMNS as f64) as usize).min(COLUMNS - 1)] += 1.0;
        }
        let (mut chi2, mut degrees) = (0.0, 0.0f64);
        for (count, expected) in counts.iter().zip(&expected) {
            let expected = expected / profile.total() * N as f64;
            if expected > 10.0 {
                chi2 += (count - expected) * (count - expected) / (expected + (0.01 * expected).powi(2));
                degrees += 1.0;
            }
        }
        assert!(degrees > 10.0 && chi2 < degrees + 5.0 * (2.0 * degrees).sqrt(), "{index}: χ² {chi2} over {degrees}");
    }
}

/// Where all directions send the same, the sum is the solid angle; where cos θ is measured finely, π.
#[test]
fn sums_have_closed_forms() {
    let even = ies(&file(&[0.0, 50.0, 180.0], &[0.0, 100.0, 300.0], |_, _| 3.0)).unwrap();
    assert!((even.total() - 4.0 * PI).abs() < 1e-12);
    let half = ies(&file(&[90.0, 180.0], &[0.0], |_, _| 3.0)).unwrap();
    assert!((half.total() - 2.0 * PI).abs() < 1e-12);
    let fine: Vec<f64> = (0..=900).map(|i| f64::from(i) / 10.0).collect();
    let cosine = ies(&file(&fine, &[0.0], |v, _| v.to_radians().cos())).unwrap();
    assert!((cosine.total() - PI).abs() < 1e-5, "{}", cosine.total());
}

/// What is said of a part of all directions says the rest by symmetry, in each way of writing it.
#[test]
fn symmetries_are_what_they_stand_for() {
    // Symmetric about both planes.
    let both = |v: f64, h: f64| 200.0 + v * (2.0 * h.to_radians()).cos();
    // About the plane of 0 and 180, and of 90 and 270.
    let along = |v: f64, h: f64| 200.0 + v * h.to_radians().cos();
    let across = |v: f64, h: f64| 200.0 + v * h.to_radians().sin();
    let steps = |from: i32, to: i32| (from / 15..=to / 15).map(|i| f64::from(15 * i)).collect::<Vec<_>>();
    for (name, whole, part) in [
        ("both", file(&VERTICAL, &steps(0, 360), both), file(&VERTICAL, &steps(0, 90), both)),
        ("along", file(&VERTICAL, &steps(0, 360), along), file(&VERTICAL, &steps(0, 180), along)),
        ("across", file(&VERTICAL, &steps(0, 345), across), file(&VERTICAL, &steps(90, 270), across)),
    ] {
        let (whole, part) = (ies(&whole).unwrap(), ies(&part).unwrap());
        let mut stream = random(50);
        for _ in 0..1000 {
            let o = sampling::sphere(stream.uniform2());
            let (a, b) = (whole.at(o), part.at(o));
            assert!((a - b).abs() < 1e-9, "{name}, {o}: {a} and {b}");
        }
    }
}

/// The years' headers, tilts that are included, and the same lamp as a EULUMDAT file.
#[test]
fn lamps_are_read_however_they_are_written() {
    let text = file(&[0.0, 45.0, 90.0], &[0.0, 90.0, 180.0, 270.0], odd);
    let expected = ies(&text).unwrap();
    let (_, rest) = text.split_once("TILT=NONE\n").unwrap();
    let mut planes = String::new();
    for h in [0.0, 90.0, 180.0, 270.0] {
        for v in [0.0f64, 45.0, 90.0] {
            writeln!(planes, "{}", odd(v, h).to_string().replace('.', ",")).unwrap();
        }
    }
    let lines = |n: usize| "text\r\n".repeat(n);
    let ldt = format!(
        "volpm\r\n1\r\n0\r\n4\r\n90\r\n3\r\n45\r\n{}1\r\n{}0\r\n90\r\n180\r\n270\r\n0\r\n45\r\n90\r\n{planes}",
        lines(18),
        lines(16)
    );
    let with = |head: &str| ies(&format!("{head}{rest}"));
    for (name, profile) in [
        ("1986", with("A lamp of 1986\nTILT=NONE\n")),
        ("1991", with("IESNA91\n[MANUFAC]\u{fffd}\nTILT=NONE\r\n")),
        ("2002", with("IESNA:LM-63-2002\n[MORE] TILT\n TILT=NONE \n")),
        ("tilted", with("IESNA:LM-63-1995\nTILT=INCLUDE\n1\n3\n0 45 90\n1, .9\n.8\n")),
        ("one line", ies(&format!("TILT=NONE\n{}", rest.replace('\n', " ")))),
        ("EULUMDAT", Profile::parse(ldt.as_bytes(), true)),
    ] {
        let profile = profile.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!((profile.total() - expected.total()).abs() < 1e-9, "{name}");
        let o = DVec3::new(0.3, -0.5, 0.6).normalize();
        assert!((profile.at(o) - expected.at(o)).abs() < 1e-12, "{name}");
    }
}

/// What is wrong is said with its line, or with what was expected.
#[test]
fn what_is_wrong_is_named() {
    let good = file(&[0.0, 45.0, 90.0], &[0.0, 90.0], odd);
    for (from, to, expected) in [
        ("TILT=NONE", "TILT NONE", "TILT="),
        ("TILT=NONE", "TILT=lamp.tlt", "line 3: TILT=lamp.tlt is another file"),
        ("1 1000 2.5 3 2 1", "1 1000 2.5 3 2 2", "type 2; expected 1"),
        ("1 1000 2.5", "1 1000 0", "multiplier 0"),
        ("2.5 3 2", "2.5 3 two", "line 4: found \"two\"; expected the number of horizontal angles"),
        ("2.5 3 2", "2.5 0 2", "gives 0 as the number of vertical angles"),
        ("2.5 3 2", "2.5 999999 999999", "directions; expected at most"),
        ("2.5 3 2", "2.5 300 2", "truncated"),
        ("0 45 90", "0 45 45", "do not grow: 45 after 45"),
        ("0 45 90", "0 45 200", "vertical angles from 0 to 200"),
        ("0 45 90\n0 90", "0 45 90\n0 100", "horizontal angles from 0 to 100"),
        ("\n10 ", "\n-10 ", "an intensity of -10"),
        ("\n10 ", "\nNaN ", "an intensity of NaN"),
    ] {
        let text = good.replacen(from, to, 1);
        assert_ne!(text, good, "{from}");
        let error = ies(&text).unwrap_err();
        assert!(error.contains(expected), "{from} to {to}: {error}");
    }
    assert!(ies(&file(&[0.0, 90.0], &[0.0], |_, _| 0.0)).unwrap_err().contains("dark"));
}

/// Bytes that were changed, cut, doubled or made up are read or refused, never worse; what is read can be drawn from.
#[test]
fn hostile_files_do_no_harm() {
    let all = [0.0, 90.0, 200.0];
    let good = [file(&VERTICAL, &all, odd), file(&[0.0, 90.0], &[0.0], odd)];
    let words =
        ["1e308", "-1", "NaN", "inf", "99999999999999999999", "0", "1e-308", "TILT=INCLUDE", ",", "\u{0}", "180"];
    let mut stream = random(70);
    let mut read = 0;
    for round in 0..20_000 {
        let mut bytes = good[round % 2].clone().into_bytes();
        for _ in 0..1 + round % 4 {
            let mut below = |n: usize| ((stream.uniform() * n as f64) as usize).min(n.saturating_sub(1));
            let at = below(bytes.len());
            match below(5) {
                0 => bytes[at] = below(256) as u8,
                1 => bytes.truncate(at + 1),
                2 => {
                    let end = (at + below(40)).min(bytes.len());
                    let part = bytes[at..end].to_vec();
                    bytes.splice(at..at, part);
                }
                _ => {
                    // A word for a word.
                    let start = bytes[..at].iter().rposition(u8::is_ascii_whitespace).map_or(0, |i| i + 1);
                    let end = bytes[at..].iter().position(u8::is_ascii_whitespace).map_or(bytes.len(), |i| at + i);
                    bytes.splice(start..end.max(start), words[below(words.len())].bytes());
                }
            }
        }
        if let Ok(profile) = Profile::parse(&bytes, round % 8 > 5) {
            read += 1;
            for _ in 0..4 {
                let o = profile.sample(&mut stream);
                let text = || String::from_utf8_lossy(&bytes).into_owned();
                assert!((o.length() - 1.0).abs() < 1e-9 && (0.0..=1.0 + 1e-9).contains(&profile.at(o)), "{}", text());
                assert!(profile.total() > 0.0 && profile.total() < 12.6, "{}", text());
            }
        }
    }
    assert!(read > 1000, "{read}");
}
