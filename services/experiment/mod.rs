//! exploration
pub mod cli;
mod run;
use std::process::ExitCode;
pub fn main(a: &cli::Experiment) -> ExitCode {
    use experiment::*;
    let rate = Rate::nearest(a.rate).unwrap();
    let t0=std::time::Instant::now();
    for seed in a.seed..a.seed+2 {
    if a.number==Some(3) {
        let o = run::run(run::Which{experiment:Experiment::Foyer,seed,rate},1200.0,&mut run::NoSink).unwrap();
        for (m,p) in o.maps.iter().zip(run::PRESETS) { println!("seed {seed} {p:?}"); experiment::claims::explore_foyer(&m.shares); }
    } else {
        let o1 = run::run(run::Which{experiment:Experiment::Static,seed,rate},120.0,&mut run::NoSink).unwrap();
        let o2 = run::run(run::Which{experiment:Experiment::Walkers,seed,rate},225.0,&mut run::NoSink).unwrap();
        for ((m1,m2),p) in o1.maps.iter().zip(&o2.maps).zip(run::PRESETS) { println!("seed {seed} {p:?}"); experiment::claims::explore_room(&m1.shares,&m2.shares,&o1.ground,&o2.footprints); }
    }
    eprintln!("{:?}",t0.elapsed());
    }
    ExitCode::SUCCESS
}
