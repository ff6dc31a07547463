# Robots on which people publish, five seeds of two methods on the track auto; an ant by one method.
# CPU time: 14 hours
# Makes: robots learners
stlbench run studies/robots.yaml
stlbench report results/robots
stlbench export results/robots --format jsonl
stlbench run studies/robots-patrol.yaml
stlbench report results/robots-patrol
stlbench export results/robots-patrol --format jsonl
stlbench run studies/robots-ant.yaml --methods raw
stlbench report results/robots-ant
stlbench export results/robots-ant --format jsonl
stlbench run studies/robots-ant-penalty.yaml
stlbench report results/robots-ant-penalty
stlbench export results/robots-ant-penalty --format jsonl
stlbench run studies/robots-ant-lasting.yaml
stlbench report results/robots-ant-lasting
stlbench export results/robots-ant-lasting --format jsonl
for task in cheetah-band fetch-avoid walker-band; do python studies/learners.py $task 100; done
for task in cheetah-band fetch-avoid; do python studies/learners.py $task 101; done
python studies/learners.py walker-band 101 td3 "td3[gradient_steps=2]" "td3[action_penalty=0.02]" "td3[action_penalty=0.02,gradient_steps=2]"
