# The rows of docs/comparison.md. `make baselines` trains and evaluates what is missing; whatever was interrupted goes on
# where it was. -S and -M are the laws of accuracy.mk, evaluated here as the others are.
COMPARED := docs/results/baselines
METHODS := nclaws spline gns identified
# Where each method's run folder is; the analytic law has none.
$(foreach method,$(METHODS),$(eval folder_$(method) = outputs/baselines/$$(1)_$(method)))
folder_single = $(LAWS)/$(1)_single
folder_multi = $(LAWS)/$(1)_multi
COMPARED_TASKS := reconstruction long_term geometry unseen

# $(call baseline_training,material,method)
define baseline_training
outputs/baselines/$(1)_$(2)/metrics.json: | $(INSTALLED)
	$$(RUN) pcnclaws.train experiment=$(2)_$(1) output=outputs/baselines/$(1)_$(2) threads=1 data.folder=outputs/data/$(1)
endef

# $(call learned,material,method): its evaluations, and the metrics of its training
define learned
$(foreach task,$(COMPARED_TASKS),$(call compared_task,$(1),$(2),$(task),$(folder_$(2)),$(folder_$(2))/metrics.json))
$(COMPARED)/$(1)/$(2)/training.json: $(folder_$(2))/metrics.json
	@mkdir -p $$(@D) && cp $$< $$@
COMPARED_ROWS += $(COMPARED)/$(1)/$(2)/training.json $(COMPARED_TASKS:%=$(COMPARED)/$(1)/$(2)/%.json)
endef

# $(call analytic,material)
define analytic
$(foreach task,$(COMPARED_TASKS),$(call compared_task,$(1),analytic,$(task),analytic,))
COMPARED_ROWS += $(COMPARED_TASKS:%=$(COMPARED)/$(1)/analytic/%.json)
endef

# $(call compared_task,material,method,task,law,prerequisite): on the scene of the training, but for unseen parameters
define compared_task

$(COMPARED)/$(1)/$(2)/$(3).json: $(5) | $(INSTALLED)
	$$(RUN) pcnclaws.evaluate material=$(1) law=$(4) task=$(3) $(if $(filter unseen,$(3)),,task.scene=train-00) \
		threads=1 picture=false floor=false may_diverge=true output=$$@

endef

$(foreach material,$(FAMILY),$(foreach method,$(METHODS),$(eval $(call baseline_training,$(material),$(method)))))
$(foreach material,$(FAMILY),$(foreach method,$(METHODS) single multi,$(eval $(call learned,$(material),$(method)))))
$(foreach material,$(FAMILY),$(eval $(call analytic,$(material))))

.PHONY: baselines
baselines: $(COMPARED_ROWS) ## train and evaluate what docs/comparison.md lacks: hours, and it can be interrupted
