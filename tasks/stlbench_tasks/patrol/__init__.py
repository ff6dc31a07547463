"""Two regions to visit again and again, by a robot that noise disturbs."""
