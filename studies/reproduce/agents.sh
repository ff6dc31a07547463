# What the parts of the agents are worth, and other agents beside ours.
# CPU time: half an hour
# Makes: parts-of-agents
train() {
    stlbench run --results results/agents --methods raw "$@"
}
train --seeds 2 --tasks fetch-reach --agents "td3[averaging=0],sb3-td3,sb3-sac,sb3-ppo"
train --seeds 5 --tasks reach-stay,robot-nav \
    --agents "dqn[head=joint],dqn[averaging=0],dqn[n_steps=1],dqn[double=false]"
train --seeds 2 --tasks pendulum --agents "dqn[head=joint],dqn[averaging=0]"
stlbench report results/agents
stlbench export results/agents --format jsonl
