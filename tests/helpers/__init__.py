"""What several folders of tests share: tasks on a line, synthetic results, scripted cells, generated formulas."""
