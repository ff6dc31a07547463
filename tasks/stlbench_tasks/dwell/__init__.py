"""One of two regions to reach and to stay in, by a robot that noise disturbs."""
