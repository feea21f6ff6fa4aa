//! The page of a comparison: what it says, and how it behaves in a browser.

use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;
use volpm::compare::results::*;
use volpm::image::{self, Image, ToneSettings};
use volpm::report;

use crate::support::browser::Browser;

const WIDTH: usize = 120;
const HEIGHT: usize = 90;
const SECONDS: [f64; 5] = [1.0, 2.0, 4.0, 8.0, 16.0];
const SEEDS: f64 = 4.0;

/// What a variant is made to do: noise of one second, bias, and the first budget it reaches.
struct Kind {
    name: &'static str,
    method: &'static str,
    noise: f64,
    bias: f64,
    first: usize,
}

const KINDS: [Kind; 4] = [
    Kind { name: "path", method: "path", noise: 0.2, bias: 0.0, first: 0 },
    Kind { name: "beam", method: "photon", noise: 0.03, bias: 0.004, first: 0 },
    Kind { name: "beam-wide", method: "photon", noise: 0.008, bias: 0.07, first: 0 },
    Kind { name: "point-uniform", method: "photon", noise: 0.1, bias: 0.005, first: 3 },
];

/// Noise of mean 0 and variance 1 by place and seed.
fn noise(x: usize, y: usize, c: usize, seed: u64) -> f64 {
    let mut h = (x as u64) << 40 ^ (y as u64) << 20 ^ (c as u64) << 10 ^ seed;
    for _ in 0..3 {
        h = (h ^ (h >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    ((h >> 11) as f64 / (1u64 << 53) as f64 - 0.5) * 12f64.sqrt()
}

fn truth(x: f64, y: f64, c: usize) -> f64 {
    let beam = (-((x - y - 10.0) / 9.0).powi(2)).exp();
    0.15 + 0.6 * beam * [1.0, 0.8, 0.5][c] + 0.1 * (1.0 - y / HEIGHT as f64)
}

fn write(dir: &Path, name: &str, value: impl Fn(usize, usize, usize) -> f64) -> String {
    let image = Image::from_fn(WIDTH, HEIGHT, |x, y| [0, 1, 2].map(|c| value(x, y, c) as f32));
    image::write(dir.join(name), &image.into(), &ToneSettings::default()).unwrap();
    name.to_string()
}

/// A figure known to a tenth.
fn figure(value: f64) -> Figure {
    Figure { value, error: Some(0.1 * value.abs()) }
}

fn figures(noise: f64, bias: f64) -> Figures {
    let mse = noise * noise + bias * bias;
    // Without bias, what is found is as often negative as positive.
    let bias2 = if bias == 0.0 { -0.02 * noise * noise } else { bias * bias };
    Figures {
        mean: [figure(0.3), figure(0.25), figure(0.2)],
        mse: figure(mse),
        rmse: figure(mse.sqrt()),
        relmse: Some(figure(mse / 0.09)),
        bias2: Some(Figure { value: bias2, error: Some(0.05 * noise * noise) }),
        variance: Some(figure(noise * noise)),
    }
}

fn measure(dir: &Path, kind: &Kind, k: usize) -> Measured {
    let spread = kind.noise / SECONDS[k].sqrt();
    // A wide kernel takes light from where it is bright to where it is not.
    let blurred = |x: usize, y: usize, c: usize| {
        let (x, y) = (x as f64, y as f64);
        let around = (0..8).map(|i| (TAU * f64::from(i) / 8.0).sin_cos()).map(|(s, c)| (9.0 * s, 9.0 * c));
        let mean = around.map(|(u, v)| truth(x + u, y + v, c)).sum::<f64>() / 8.0;
        truth(x, y, c) + kind.bias / 0.07 * (mean - truth(x, y, c))
    };
    let name = format!("{}-{k}", kind.name);
    let image = write(dir, &format!("{name}.exr"), |x, y, c| blurred(x, y, c) + spread * noise(x, y, c, k as u64 + 1));
    let mean_image = write(dir, &format!("{name}-mean.exr"), |x, y, c| {
        blurred(x, y, c) + spread / SEEDS.sqrt() * noise(x, y, c, k as u64 + 100)
    });
    Measured {
        seconds: Figure { value: 0.97 * SECONDS[k], error: Some(0.01) },
        cpu_seconds: None,
        passes: u64::from(kind.method == "photon") * (k as u64 + 1),
        samples: 4 << k,
        tuned: None,
        image,
        mean_image: Some(mean_image),
        regions: vec![figures(spread, kind.bias), figures(2.0 * spread, 3.0 * kind.bias)],
    }
}

/// A comparison of four variants; one of them reaches only two budgets.
fn comparison(dir: &Path) -> Results {
    let image = write(dir, "reference.exr", |x, y, c| truth(x as f64, y as f64, c));
    let set = vec![Setting { key: "volume.kernel".into(), value: "\"<fixed>\"".into() }];
    let region = |name: &str, x, y, width, height| Region { name: name.into(), x, y, width, height };
    let variant = |kind: &Kind| Variant {
        name: kind.name.into(),
        method: kind.method.into(),
        set: if kind.bias > 0.0 { set.clone() } else { Vec::new() },
        notes: Vec::new(),
        limit: None,
        loading_seconds: 0.25,
        statistics: Statistics {
            passes: 5,
            samples: 64,
            emitted: 1_234_567,
            photons: 400_000,
            photons_seconds: 1.5,
            build_seconds: 0.5,
            render_seconds: 13.5,
            queries: 98_765,
            photons_per_query: (kind.method == "photon").then_some(321.5),
            queries_per_sample: 1.25,
            radii: (kind.method == "photon").then_some([0.011, 0.052, 0.31]),
            map_bytes: 47_000_000,
            peak_bytes: Some(330_000_000),
        },
        measures: (0..SECONDS.len())
            .map(|k| Measure { budget: SECONDS[k], measured: (k >= kind.first).then(|| measure(dir, kind, k)) })
            .collect(),
    };
    Results {
        version: VERSION,
        program: Program { name: "volpm".into(), version: "0.1.0".into(), commit: Some("abc1234".into()) },
        machine: Machine { cpu: Some("Some CPU".into()), logical_cores: 2, os: "linux x86_64".into() },
        threads: 2,
        complete: true,
        scene: Scene {
            path: "scenes/fog.toml".into(),
            title: Some("Fog & <b>\"light\"</b>".into()),
            text: "# </pre></script><script>alert(1)</script>\n[film]\nwidth = 120\n".into(),
            width: WIDTH as u32,
            height: HEIGHT as u32,
            exposure: Some(0.0),
            filmic: true,
        },
        study: Study {
            text: None,
            budgets: Budgets { kind: BudgetKind::Seconds, values: SECONDS.to_vec() },
            seeds: vec![1, 2, 3, 4],
            set: Vec::new(),
            layer: None,
            same_map: None,
        },
        reference: Reference {
            kind: ReferenceKind::Made,
            method: Some("path".into()),
            image: Some(image),
            standard_error: Some(0.004),
            samples: Some(65536),
            seconds: Some(900.0),
            set: Vec::new(),
            regions: Vec::new(),
        },
        regions: vec![region("image", 0, 0, WIDTH as u32, HEIGHT as u32), region("edge", 40, 30, 24, 18)],
        variants: KINDS.iter().map(variant).collect(),
        warnings: vec!["a <warning>".into()],
    }
}

/// Texts between `start` and `end`, tags left out.
fn between<'t>(text: &'t str, start: &str, end: &str) -> &'t str {
    let from = text.find(start).unwrap_or_else(|| panic!("there is no {start}")) + start.len();
    &text[from..from + text[from..].find(end).unwrap()]
}

fn without_tags(text: &str) -> String {
    let mut inside = false;
    let letters = text.chars().filter_map(|c| match c {
        '<' => {
            inside = true;
            Some(' ')
        }
        '>' => {
            inside = false;
            None
        }
        c => (!inside).then_some(c),
    });
    letters.collect::<String>().split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn the_page_says_what_the_results_say() {
    let folder = tempfile::tempdir().unwrap();
    let results = comparison(folder.path());
    report::write(&results, folder.path()).unwrap();
    let page = fs::read_to_string(folder.path().join("index.html")).unwrap();

    // After 16 s: 0.2/4, √(0.0075² + 0.004²), √(0.002² + 0.07²), √(0.025² + 0.005²).
    let summary = between(&page, "<section id=\"summary\">", "</section>");
    let said = without_tags(summary);
    assert!(said.contains("After 16 s , beam has the smallest error, RMSE 0.00850; point-uniform has 3.0 ×"), "{said}");
    assert!(said.contains("bias is most of the squared error of beam-wide (99.9 %); variance is most of the squared error of path (&gt; 90.9 %)"), "{said}");
    let row = |k: usize| without_tags(between(summary, &format!("data-row=\"{k}\">"), "</tr>"));
    assert!(row(0).contains("path 0.0500 ± 0.0050 1.0 ×") && row(0).contains("−0.500"), "{}", row(0));
    assert!(row(1).contains("beam 0.00850 ± 0.00085 5.9 ×"), "{}", row(1));
    assert!(row(2).contains("beam-wide 0.0700 ± 0.0070 0.71 ×") && row(2).contains("99.9 %"), "{}", row(2));
    // Two variants pass 0.0255, rounded up, while they are measured. beam has 0.0303 after 0.97 s and 0.0216 after twice
    // that; point-uniform falls from 0.0357 to 0.0255 in the last half of the time.
    assert!(summary.contains("<span class=\"level-value\">0.026</span>"), "{summary}");
    assert!(row(0).ends_with("&gt; 15.5 s 1 ×") && row(2).ends_with("&gt; 15.5 s –"), "{} {}", row(0), row(2));
    assert!(row(1).ends_with("1.32 s &gt; 12 ×"), "{}", row(1));
    assert!(row(3).ends_with("14.9 s &gt; 1.0 ×"), "{}", row(3));

    // A budget that was not reached is shown as such, once in each table of measures.
    let measures = between(&page, "<section id=\"measures\">", "</section>");
    assert_eq!(measures.matches("not reached").count(), 3);
    assert!(without_tags(measures).contains("7.760 ± 0.010 4 32 0.0113 ± 0.0011 6.2 ×"), "{}", without_tags(measures));
    let cost = without_tags(between(&page, "<section id=\"cost\">", "</section>"));
    for number in ["discs per ray) – 322 322", "mean radius – 0.052", "47 MB", "330 MB", "1 234 567"] {
        assert!(cost.contains(number), "{number}: {cost}");
    }
    for text in ["abc1234", "Some CPU", "0.40 %", "65\u{202f}536 samples", "15 min"] {
        assert!(page.contains(text), "{text}");
    }

    // Side by side: the reference, and the variants above their errors, of which most are not 0.
    let overview = image::read(folder.path().join("overview.png")).unwrap().image;
    assert_eq!((overview.width, overview.height), (5 * (WIDTH + 2) - 2, 2 * (HEIGHT + 2) - 2));
    let coloured = |column: usize| {
        let pixels = (0..WIDTH * HEIGHT).map(|i| (column * (WIDTH + 2) + i % WIDTH, HEIGHT + 2 + i / WIDTH));
        pixels.filter(|&(x, y)| overview.get(x, y).iter().any(|&value| value < 0.9)).count()
    };
    assert_eq!(coloured(0), 0);
    assert!(
        (1..5).all(|column| coloured(column) > WIDTH * HEIGHT / 4),
        "{:?}",
        (1..5).map(coloured).collect::<Vec<_>>()
    );

    // What users write stays text.
    assert!(page.contains("Fog &amp; &lt;b&gt;&quot;light&quot;&lt;/b&gt;") && page.contains("a &lt;warning&gt;"));
    assert!(page.contains("# &lt;/pre&gt;&lt;/script&gt;&lt;script&gt;alert(1)"));
    assert_eq!(page.matches("<script").count(), 2, "the data and the script");
    // Nothing comes from elsewhere, and all that is named is there.
    let names = page.split(['"', ' ', '(']).filter(|word| word.contains("://"));
    assert!(names.clone().all(|name| name == "http://www.w3.org/2000/svg"), "{:?}", names.collect::<Vec<_>>());
    for attribute in ["src=\"", "href=\""] {
        for path in page.split(attribute).skip(1).map(|rest| rest.split('"').next().unwrap()) {
            let known = path.starts_with(['#']) || ["data:,", "results.json", "results.csv"].contains(&path);
            assert!(known || folder.path().join(path).is_file(), "{path}");
        }
    }
}

#[test]
fn the_plot_has_a_line_for_each_variant() {
    let folder = tempfile::tempdir().unwrap();
    let mut results = comparison(folder.path());
    report::write(&results, folder.path()).unwrap();
    let svg = fs::read_to_string(folder.path().join("curve.svg")).unwrap();
    let groups: Vec<&str> = svg.split("<g class=\"curve\"").skip(1).collect();
    assert_eq!(groups.len(), 4);
    for (kind, group) in KINDS.iter().zip(&groups) {
        assert!(group.contains(&format!("data-variant=\"{}\"", kind.name)));
        let group = group.split("<g class=\"names\"").next().unwrap();
        assert_eq!(group.matches("<polyline").count(), 1);
        let points = between(group, "points=\"", "\"").split_whitespace().count();
        assert_eq!((points, group.matches("class=\"point\"").count()), (5 - kind.first, 5 - kind.first));
    }
    // Halving twice the error in four times the time: a line of slope −1/2 in both halves of the plot.
    let path: Vec<[f64; 2]> = between(groups[0], "points=\"", "\"")
        .split_whitespace()
        .map(|pair| pair.split_once(',').map(|(x, y)| [x.parse().unwrap(), y.parse().unwrap()]).unwrap())
        .collect();
    let steps: Vec<[f64; 2]> = path.windows(2).map(|pair| [pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]]).collect();
    for step in &steps {
        assert!((step[0] - steps[0][0]).abs() <= 2.0 && (step[1] - steps[0][1]).abs() <= 2.0 && step[1] > 0.0);
    }

    // Budgets in samples: compared at the last time at which all were measured.
    let mut sampled = results.clone();
    sampled.study.budgets = Budgets { kind: BudgetKind::Samples, values: vec![4.0, 8.0, 16.0, 32.0, 64.0] };
    report::write(&sampled, folder.path()).unwrap();
    let page = without_tags(&fs::read_to_string(folder.path().join("index.html")).unwrap());
    assert!(page.contains("After 15.5 s , beam has the smallest error, RMSE 0.00850; point-uniform has 3.0 ×"));
    assert!(page.contains("FLIP at 64 samples"));

    // What a comparison may lack does not keep it from being shown.
    results.variants[3].measures.iter_mut().for_each(|measure| measure.measured = None);
    results.reference.image = None;
    results.regions.truncate(1);
    results.complete = false;
    let mut plain = results.clone();
    for measured in plain.variants.iter_mut().flat_map(|v| &mut v.measures).filter_map(|m| m.measured.as_mut()) {
        measured.mean_image = None;
        measured.regions.truncate(1);
        let figures = &mut measured.regions[0];
        (figures.relmse, figures.bias2, figures.variance) = (None, None, None);
        (figures.rmse, figures.mse) = (Figure { value: 0.0, error: None }, Figure { value: 0.0, error: None });
    }
    let mut nothing = plain.clone();
    nothing.variants.iter_mut().flat_map(|variant| &mut variant.measures).for_each(|measure| measure.measured = None);
    let mut empty = nothing.clone();
    empty.variants.clear();
    for (name, results) in [("some", &results), ("plain", &plain), ("nothing", &nothing), ("empty", &empty)] {
        report::write(results, folder.path()).unwrap_or_else(|error| panic!("{name}: {error}"));
        let page = fs::read_to_string(folder.path().join("index.html")).unwrap();
        assert!(page.contains("Interrupted.") && !page.contains("NaN") && !page.contains(">inf"), "{name}");
    }
    // An image of another size is refused.
    let small = Image::new(3, 2);
    image::write(folder.path().join("path-0.exr"), &small.into(), &ToneSettings::default()).unwrap();
    let error = report::write(&results, folder.path()).unwrap_err().to_string();
    assert!(error.contains("path-0.exr") && error.contains("3 × 2") && error.contains("120 × 90"), "{error}");
}

/// Elements that reach beyond the window, outside of what scrolls by itself.
const TOO_WIDE: &str = "[...document.body.querySelectorAll('*')]
    .filter(e => e.getBoundingClientRect().right > document.documentElement.clientWidth && !e.closest('.wide, pre, #stage'))
    .map(e => e.outerHTML.slice(0, 80))";

/// Needs Chromium: `cargo test --release --test promises -- --ignored browser`.
#[test]
#[ignore = "needs a browser"]
fn the_page_works_in_a_browser() {
    // Kept, to be looked at.
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("report");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    report::write(&comparison(&folder), &folder).unwrap();
    let mut browser = Browser::start();
    browser.open(&folder.join("index.html"), [1280, 900]);

    // The plot: a line a variant, each in a colour of its own, with the points that were measured.
    let lines = browser.evaluate(
        "[...document.querySelectorAll('.curve-figure g.curve')].map(g => [g.dataset.variant,
            g.querySelectorAll('polyline').length, g.querySelector('polyline').points.length,
            getComputedStyle(g.querySelector('polyline')).stroke])",
    );
    let lines = lines.as_array().unwrap();
    let named: Vec<_> = lines.iter().map(|line| (line[0].as_str().unwrap(), &line[1], &line[2])).collect();
    let (one, two, five) = (json!(1), json!(2), json!(5));
    let expected = [("path", &one, &five), ("beam", &one, &five), ("beam-wide", &one, &five)];
    assert_eq!(named, [&expected[..], &[("point-uniform", &one, &two)]].concat());
    let colours: std::collections::HashSet<String> = lines.iter().map(|line| line[3].to_string()).collect();
    assert_eq!(colours.len(), 4);

    // What the stage shows, as it is drawn.
    const STAGE: &str = "document.getElementById('stage').scrollIntoView({block: 'center', behavior: 'instant'})";
    browser.evaluate(STAGE);
    let shown = |browser: &mut Browser| browser.picture("#stage .layers");
    let share = |a: &Image, b: &Image| {
        assert_eq!((a.width, a.height), (b.width, b.height));
        // By halves, away from where the line between the pictures is: in the middle or at the edges.
        let differ = |from: usize, to: usize| {
            let places = (0..a.pixels.len()).filter(|i| (from..to).contains(&(i % a.width)));
            places.filter(|&i| a.pixels[i] != b.pixels[i]).count() as f64 / ((to - from) * a.height) as f64
        };
        (differ(4, a.width / 2 - 4), differ(a.width / 2 + 4, a.width - 4))
    };
    let both = shown(&mut browser);
    browser.evaluate("document.getElementById('stage').focus()");
    browser.key("f");
    let left = shown(&mut browser);
    browser.key("f");
    let right = shown(&mut browser);
    let (left_half, right_half) = share(&both, &left);
    assert!(
        left_half == 0.0 && right_half > 0.5,
        "flipped to the left: {left_half} and {right_half} of the pixels differ"
    );
    let (left_half, right_half) = share(&both, &right);
    assert!(
        left_half > 0.5 && right_half == 0.0,
        "flipped to the right: {left_half} and {right_half} of the pixels differ"
    );
    // The slider, by keys: all the way to its ends.
    browser.evaluate("document.getElementById('split').focus()");
    browser.key("Home");
    assert_eq!(share(&shown(&mut browser), &right).0, 0.0);
    browser.key("End");
    assert_eq!(share(&shown(&mut browser), &left).1, 0.0);
    // And on the picture, by the mouse.
    browser.click("#stage .layers");
    assert_eq!(share(&shown(&mut browser), &both), (0.0, 0.0));
    browser.key("m");
    browser.key("m");
    let (left_half, right_half) = share(&shown(&mut browser), &both);
    assert!(left_half > 0.9 && right_half > 0.9, "the map of FLIP is no other picture");
    assert_eq!(browser.evaluate("document.querySelector('[data-bar=flip]').hidden"), json!(false));
    // A budget that was not reached says so.
    browser.evaluate("right.value = 3; budget.value = 0; right.dispatchEvent(new Event('change'))");
    let tag = browser.evaluate("document.getElementById('right-tag').textContent");
    assert_eq!(tag, json!("point-uniform: not reached"));
    browser
        .evaluate("right.value = 1; budget.value = 4; kind.value = 'image'; right.dispatchEvent(new Event('change'))");

    // Another error to reach: 0.1, where path is after 4 s times 0.97, and beam was before its first measure.
    let row = "document.querySelector('tr[data-row=\"0\"]').innerText";
    browser.evaluate("level.value = Math.log(0.1); level.dispatchEvent(new Event('input'))");
    let said = browser.evaluate(row);
    assert!(said.as_str().unwrap().contains("3.88 s"), "{said}");
    browser.evaluate("level.value = Math.log(0.026); level.dispatchEvent(new Event('input'))");

    // Everything loads, nothing is fetched, and nothing complains: with and without the script, in light and dark.
    let broken =
        "[...document.images].filter(i => i.src && (i.loading = 'eager', !i.complete || !i.naturalWidth)).length";
    browser
        .evaluate("Promise.all([...document.images].filter(i => i.src).map(i => (i.loading = 'eager', i.decode())))");
    assert_eq!(browser.evaluate(broken), json!(0));
    assert_eq!(browser.evaluate(TOO_WIDE), json!([]));
    browser.screenshot(&folder.join("light.png"));
    browser.set_dark(true);
    browser.screenshot(&folder.join("dark.png"));
    browser.set_dark(false);
    browser.open(&folder.join("index.html"), [390, 800]);
    assert_eq!(browser.evaluate(TOO_WIDE), json!([]));
    browser.screenshot(&folder.join("narrow.png"));
    browser.set_script(false);
    browser.open(&folder.join("index.html"), [1280, 900]);
    assert_eq!(browser.evaluate("document.getElementById('viewer').hidden"), json!(true));
    browser.screenshot(&folder.join("no-script.png"));
    assert_eq!(browser.complaints, Vec::<String>::new());
    assert!(
        browser.requests.iter().all(|url| url.starts_with("file:") || url.starts_with("data:")),
        "{:?}",
        browser.requests
    );
    println!("screenshots are in {}", folder.display());
}
