import time
from rptcam_cl.device import open_session
from benchmarks.scenes import reference_scene, wavefront_of, render_samples

s = open_session()
n = 320 * 180 * 32
for org in ("stream", "passes"):
    out = []
    for d in (1, 2, 3, 4, 6):
        sc = reference_scene("C", shrink=2, max_depth=d)
        w = wavefront_of(sc, s, organisation=org)
        best = 9e9
        for _ in range(4):
            c = time.process_time()
            render_samples(w, 32)
            best = min(best, time.process_time() - c)
        out.append(round(best / n * 1e9))
    print(org, out)
