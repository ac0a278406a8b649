//! exploration
pub mod cli;
mod run;
use std::process::ExitCode;
pub fn main(a: &cli::Experiment) -> ExitCode {
    use experiment::*;
    let rate = Rate::nearest(a.rate).unwrap();
    let show=|seed:u64,p:protocol::site::Preset,v:Vec<claims::Verdict>| for v in v { println!("{seed} {p:?} {} {} {}", v.claim.id(), if v.holds {"ok"} else {"NO"}, v.measures.iter().map(|m|format!("{} {:.4}",m.name,m.value)).collect::<Vec<_>>().join(", ")); };
    for seed in a.seed..a.seed+3 {
        let o = run::run(run::Which{experiment:Experiment::Foyer,seed,rate},1200.0,&mut run::NoSink).unwrap();
        for (m,p) in o.maps.iter().zip(run::PRESETS) { show(seed,p,claims::judge_foyer(&m.shares,&o.scene,&o.ground,&o.footprints));
         if p!=protocol::site::Preset::Paper {
          for b in claims::strong_in_both(&m.shares).iter().take(5) {println!("     both n{} {:.3} {:.2?}",b.cells.len(),b.mass,b.centre_m);}
          for b in blobs(m.shares.grid(),m.shares.of(Class::Lingering),0.01,3).iter().take(6) {println!("     linger n{} {:.3} {:.2?}",b.cells.len(),b.mass,b.centre_m);}}
        }
        let o1 = run::run(run::Which{experiment:Experiment::Static,seed,rate},120.0,&mut run::NoSink).unwrap();
        let o2 = run::run(run::Which{experiment:Experiment::Walkers,seed,rate},225.0,&mut run::NoSink).unwrap();
        for ((m1,m2),p) in o1.maps.iter().zip(&o2.maps).zip(run::PRESETS) { show(seed,p,claims::judge_static(&m1.shares,&o1.ground)); show(seed,p,claims::judge_walkers(&m2.shares,&m1.shares,&o2.footprints)); }
    }
    ExitCode::SUCCESS
}
