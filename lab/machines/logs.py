"""Real machines: the simulator in examples/machines and the log of each, below the folder of real logs."""

# name: (model, log)
LOGS = {
    "hairdryer": ("hairdryer", "hairdryer/hairdryer.csv"),
    "emps": ("emps", "emps/train.csv.gz"),
    "silverbox": ("silverbox", "silverbox/snls80mv.csv.gz"),
    "tclab_step": ("tclab_step", "tclab/tclab_step_test_siso.csv"),
    "tclab_dual": ("tclab_dual", "tclab/tclab_dual_10min.csv"),
    "tclab_alone": ("tclab_alone", "tclab/tclab_dual_10min.csv"),
    "heating_system": ("heating_system", "heating_system/heating.csv"),
    "heat_exchanger": ("heat_exchanger", "heat_exchanger/exchanger.csv"),
    "winding": ("winding", "winding/winding.csv.gz"),
    "servo": ("servo", "servo_real_and_sim/servo_action_real_sim.csv"),
    "nanodrone_square": ("nanodrone", "nanodrone/raw_square_run4.csv.gz"),
    "nanodrone_random": ("nanodrone", "nanodrone/raw_random2_run1.csv.gz"),
    "nanobench": ("nanobench", "nanobench/B2_circle_fast_rep2.csv.gz"),
    "px4": ("px4", "px4_logs/px4_fmu_v6c.csv.gz"),
}
