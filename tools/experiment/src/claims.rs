//! exploration
use crate::{Shares, Class, Ground, Footprints, blobs, ground::share_near};
/// x
pub fn explore_room(s1:&Shares,s2:&Shares,g:&Ground,f:&Footprints){
    let strong=|s:&Shares,c:Class,t:f64| s.of(c).iter().map(|&x|x>=t).collect::<Vec<bool>>();
    for t in [0.2,0.5,0.8]{ let b=strong(s1,Class::Background,t);
    let b2=strong(s2,Class::Background,t);
    println!("  t{t} walls precise {:.4} complete {:.4} n {} | e2 precise {:.4} complete {:.4}", share_near(g.grid(),&b,g.surface()), share_near(g.grid(),g.surface(),&b), b.iter().filter(|x|**x).count(), share_near(g.grid(),&b2,g.surface()), share_near(g.grid(),g.surface(),&b2));}
    for t in [0.0001,0.005,0.01,0.02,0.05]{
    let path=f.path("quadrilateral",t); let n=path.iter().filter(|x|**x).count();
    let cells=||(0..path.len()).filter(|&c|path[c]);
    println!("  path t{t} n{n} passing {:.4} linger {:.4} vac {:.4} bg {:.4} transit {:.4}", s2.mean(Class::Passing,cells()),s2.mean(Class::Lingering,cells()),s2.mean(Class::Vacated,cells()),s2.mean(Class::Background,cells()),s2.mean(Class::Transit,cells()));
    }
    let obs=s2.observed().iter().filter(|x|**x).count();
    for c in [Class::Passing,Class::Lingering,Class::Vacated,Class::Transit]{
        let m:f64=s2.of(c).iter().sum(); let m1:f64=s1.of(c).iter().sum();
        let n=|t:f64|s2.of(c).iter().filter(|&&x|x>=t).count();
        println!("  {:?} mass {m:.3} (e1 {m1:.3}) cells>=.5% {} 1% {} 5% {} 20% {} of {obs}",c,n(0.005),n(0.01),n(0.05),n(0.2));
    }
}
/// x
pub fn explore_foyer(s:&Shares){
    let both:Vec<f64>=s.of(Class::Background).iter().zip(s.of(Class::Vacated)).map(|(a,b)|a.min(*b)).collect();
    for t in [0.03,0.05,0.1,0.2]{ 
      println!("  both>={t}:"); for b in blobs(s.grid(),&both,t,1).iter().take(8){println!("     n{} mass {:.3} at {:.2?}",b.cells.len(),b.mass,b.centre_m);} }
    for t in [0.01,0.02,0.05]{ println!("  linger>={t}:"); for b in blobs(s.grid(),s.of(Class::Lingering),t,1).iter().take(8){println!("     n{} mass {:.3} at {:.2?}",b.cells.len(),b.mass,b.centre_m);} }
    for c in crate::CLASSES{ println!("  {:?} mass {:.3}",c,s.of(c).iter().sum::<f64>());}
}
