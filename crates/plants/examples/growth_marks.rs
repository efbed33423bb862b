//! Prints what the species measure at the age of their tables, as the mean over seeds 1 to 4:
//! `cargo run --release -p osier-plants --example growth_marks [NAME ...] [--ages 20,40] [--set key=value,...]`
#![allow(clippy::expect_used, clippy::disallowed_methods, clippy::print_stdout, reason = "a tool for people")]

mod common;

use std::time::Instant;

use osier_base::limits::Limits;
use osier_plants::grow::years::{Site, grow};

const SEEDS: u16 = 4;

fn main() {
    let mut names = Vec::new();
    let mut ages: Vec<f64> = Vec::new();
    let mut changes: Vec<(String, Vec<f64>)> = Vec::new();
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let numbers = |text: &str| text.split(',').map(|v| v.parse::<f64>().expect("a number")).collect::<Vec<f64>>();
        match arg.as_str() {
            "--ages" => ages = numbers(&args.next().expect("ages")),
            "--set" => {
                let text = args.next().expect("key=value");
                let (key, value) = text.split_once('=').expect("key=value");
                changes.push((key.to_owned(), numbers(value)));
            }
            name => names.push(name.to_owned()),
        }
    }
    if names.is_empty() {
        names = common::names();
    }
    println!("species            age     H     W   dbh W/dbh  H/dbh  nodes k  tips k   leaf  LAI   s/tree  Strahler");
    for name in &names {
        let own = [common::spec(name, 1).age];
        for age in if ages.is_empty() { &own[..] } else { &ages[..] } {
            let mut sum = [0.0_f64; 6];
            let start = Instant::now();
            let mut ratios = String::new();
            for seed in 1..=SEEDS {
                let mut spec = common::spec(name, u64::from(seed));
                spec.age = *age;
                for (key, values) in &changes {
                    spec.habit.set(key, values).expect("a change");
                }
                let grown = grow(&[spec], &Site::default(), &Limits::default()).expect("grows");
                let m = grown[0].measures();
                let values = [m.height, m.crown_width, m.dbh, m.leaf_area, m.nodes as f32, m.tips as f32];
                sum.iter_mut().zip(values).for_each(|(s, v)| *s += f64::from(v) / f64::from(SEEDS));
                if seed == 1 {
                    let counts = grown[0].strahler_counts();
                    let steps = counts.windows(2).map(|c| format!(" {:.1}", c[0] as f64 / c[1] as f64));
                    ratios = steps.collect();
                }
            }
            let seconds = start.elapsed().as_secs_f64() / f64::from(SEEDS);
            let [height, width, dbh, leaf, nodes, tips] = sum;
            let index = leaf / (std::f64::consts::FRAC_PI_4 * width * width);
            println!(
                "{name:16} {age:5} {height:5.1} {width:5.1} {dbh:5.2} {:5.1} {:6.1} {:8.1} {:7.1} {leaf:6.0} {index:4.1} {seconds:8.2} {ratios}",
                width / dbh,
                height / dbh,
                nodes / 1e3,
                tips / 1e3,
            );
        }
    }
}
